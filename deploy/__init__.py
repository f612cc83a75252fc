"""Runtimes that start, show and stop a swarm on one machine."""
