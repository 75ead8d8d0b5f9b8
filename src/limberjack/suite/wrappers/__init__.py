"""Wrappers of environments: pictures as observations, scaled actions, noisy actions."""
