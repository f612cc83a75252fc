"""Finds what a wish names on its site."""
