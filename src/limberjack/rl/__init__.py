"""Reinforcement-learning interface: environments, batches, tasks and the physics contract."""
