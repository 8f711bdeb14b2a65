"""Instances that solve by name: a TOML file each, read as `placement solve NAME`."""
