"""The manipulator's costs: bringing and inserting a ball or a peg."""
