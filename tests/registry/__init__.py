"""Tests of `limberjack.registry`."""
