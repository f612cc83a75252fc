"""Sensing: opening the world that a process lives in, and what a robot tells of itself."""
