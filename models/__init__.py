"""What the world does: roads, cameras, errors, vehicles, filters; nothing of optimisation."""
