"""What holds for every task of the suite."""
