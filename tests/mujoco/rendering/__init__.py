"""Tests of `limberjack.mujoco.rendering`."""
