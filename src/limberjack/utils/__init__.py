"""Helpers that know nothing of MuJoCo: rewards, arrays, registries, XML, files, suggestions."""
