"""Helpers independent of MuJoCo: rewards, arrays, registries, XML, files, suggestions."""
