"""Tests of `limberjack.report`."""
