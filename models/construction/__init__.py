"""Roads between two poses around obstacles: classes of ways, lines and arcs, clothoids."""
