"""The fewest cameras within tolerance: construction along the road, and its lower bound."""
