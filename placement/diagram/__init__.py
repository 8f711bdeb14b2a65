"""A relaxed decision diagram along the road: a running lower bound for minimised objectives."""
