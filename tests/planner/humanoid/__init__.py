"""Tests of `limberjack.planner.humanoid`."""
