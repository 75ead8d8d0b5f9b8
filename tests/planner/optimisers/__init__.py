"""Tests of the planner's optimisers."""
