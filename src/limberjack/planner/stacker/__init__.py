"""The stacker's cost: building a tower of boxes."""
