"""One reader a road-file format; each gives roads and obstacles."""
