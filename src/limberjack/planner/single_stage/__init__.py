"""Costs of tasks without stages: to swing something up, to move forward, and to reach a target."""
