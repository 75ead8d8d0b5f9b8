"""Tests of `limberjack.mujoco`."""
