"""Tests of `limberjack.viewer`."""
