"""Tests of `limberjack.install_as_dm_control` and of `limberjack._compat`."""
