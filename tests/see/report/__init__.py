"""Tests of `limberjack.see.report`."""
