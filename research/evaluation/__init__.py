"""Experiments on worlds without a network: precision of fusion algorithms and policies."""
