"""Reinforcement-learning interface: environments, tasks and the physics contract."""
