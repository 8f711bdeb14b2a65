"""Instances, rivals, suites and the runner that compares solvers."""
