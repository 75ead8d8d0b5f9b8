"""What holds for the source and the package as a whole."""
