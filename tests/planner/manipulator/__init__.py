"""Tests of `limberjack.planner.manipulator`."""
