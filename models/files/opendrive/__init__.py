"""Read ASAM OpenDRIVE 1.4–1.8: reference lines and lanes evaluated from their formulas."""

from models.files.opendrive.reader import read_opendrive

__all__ = ["read_opendrive"]
