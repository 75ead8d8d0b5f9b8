"""Tests of `limberjack.utils`."""
