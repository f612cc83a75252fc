"""Loops in C, for those machines on which they could be compiled; see `library`."""
