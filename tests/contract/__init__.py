"""Properties of the source and of the package as a whole."""
