"""Tests of `limberjack.policies`."""
