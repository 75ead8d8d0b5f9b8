"""Tests of limberjack.data."""
