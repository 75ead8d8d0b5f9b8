"""Tests of `limberjack.recording`."""
