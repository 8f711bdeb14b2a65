"""Kernels that make a gain cost its own window: stored messages from before and after it."""
