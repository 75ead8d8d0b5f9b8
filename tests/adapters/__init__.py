"""Tests of `limberjack.adapters`."""
