"""The tempered chain bound: between the chain of conditional gains and the concave relaxation."""
