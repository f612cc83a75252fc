"""Perception: LiDAR in, objects and boxes out. Pure functions on arrays, no I/O and no Zenoh."""
