"""Tests of `limberjack.planner.stacker`."""
