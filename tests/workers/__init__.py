"""Tests of limberjack.workers."""
