"""What the world does: roads, cameras, their errors, vehicles, filters. Knows nothing of optimisation."""
