"""Choices (P, a): found, scored, checked, and kept while they are good enough."""
