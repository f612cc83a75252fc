"""Trains the detectors on the simulated worlds."""
