"""Tests of `limberjack.suite.utils`."""
