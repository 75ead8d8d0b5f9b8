"""Helpers: rewards, arrays, rotations, registries, XML, files, suggestions.

They are independent of MuJoCo, except for inverse kinematics.
"""
