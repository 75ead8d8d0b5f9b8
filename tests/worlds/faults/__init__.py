"""Tests of `limberjack.worlds.faults`."""
