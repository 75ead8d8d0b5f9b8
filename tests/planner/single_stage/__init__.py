"""Tests of the costs of tasks without stages."""
