"""Tests of `limberjack.suite.wrappers`."""
