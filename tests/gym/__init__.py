"""Tests of `limberjack.gym`."""
