"""Fusion algorithms: a file each, with the function `fusion(detector)`.

The file's name, with hyphens for underscores, is the algorithm's.
"""
