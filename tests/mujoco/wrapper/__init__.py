"""Tests of `limberjack.mujoco.wrapper`."""
