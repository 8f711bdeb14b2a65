"""The tempered chain to second order over millions of arcs: a sieve for lines that are long."""
