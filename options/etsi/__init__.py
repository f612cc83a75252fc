"""Collective Perception Messages of ETSI TS 103 324, for those who know nothing of the project."""
