"""Exact search for dense designs: a node's relaxation, its certificate, the tree, swaps."""
