"""One file a solution method."""
