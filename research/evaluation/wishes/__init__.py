"""Measures how well wishes are understood, beside what understands nothing."""
