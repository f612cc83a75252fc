"""Fusion algorithms, one file each, found by name."""
