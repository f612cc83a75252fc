"""Reads the times that a wish says."""
