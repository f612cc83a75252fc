"""Decisions of `coverage` in simulated scenes: what a small model learns to decide from."""
