"""One file an objective: its value, the gain of a candidate, its gradient."""
