"""Tests of `limberjack.worlds`."""
