"""Placements over a whole road network: a million poses, thousands of cameras, a certificate."""
