"""PyBullet worlds for simulated drops; recording and replay of scripts that use PyBullet."""
