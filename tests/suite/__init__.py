"""Tests of `limberjack.suite`."""
