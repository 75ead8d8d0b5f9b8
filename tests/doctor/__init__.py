"""Tests of `limberjack.doctor`."""
