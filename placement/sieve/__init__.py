"""The tempered chain to second order over millions of arcs, by classes of cameras before."""
