"""Balance a pole with a linear policy, and ask why its episodes end."""

import gymnasium
import numpy as np

GAIN = np.array([0.0, 4.0, 0.0, 0.2])  # of cart, pole, and their velocities

env = gymnasium.make("InvertedPendulum-v5")
for seed in range(3):
    observation, _ = env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        action = np.atleast_1d(GAIN @ observation)
        observation, _, terminated, truncated, _ = env.step(action.astype(np.float32))
