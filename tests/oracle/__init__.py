"""Live comparison with dm_control 1.0.50, on the same MuJoCo and in the same process."""
