"""Tests of `limberjack.rl`."""
