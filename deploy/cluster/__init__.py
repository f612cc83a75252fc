"""A swarm on many machines, described for an engine that people already run."""
