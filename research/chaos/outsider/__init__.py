"""A process that has no part in the swarm and connects to its router all the same."""
