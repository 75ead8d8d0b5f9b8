"""Properties of every task of the suite."""
