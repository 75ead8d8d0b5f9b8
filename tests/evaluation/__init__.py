"""Tests of `limberjack.evaluation`."""
