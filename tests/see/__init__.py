"""Tests of `limberjack.see`."""
