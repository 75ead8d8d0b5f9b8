"""Environment wrappers: pixel observations, scaled actions, noisy actions."""
