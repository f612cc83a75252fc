"""Faults played on a real swarm by a seeded schedule, and what must hold all the same."""
