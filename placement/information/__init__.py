"""What each candidate pose tells about each path sample: sparse, precomputed by culled kernels."""

from placement.information.precompute import Information, compute_information

__all__ = ["Information", "compute_information"]
