"""MuJoCo worlds for simulated drops; recording and explaining of scripts that use MuJoCo."""
