"""The chain bound: along a road, cameras two apart hardly matter to each other."""
