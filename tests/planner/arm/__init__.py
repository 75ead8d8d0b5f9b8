"""Tests of `limberjack.planner.arm`."""
