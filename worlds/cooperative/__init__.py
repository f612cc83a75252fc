"""Frames of a world as a swarm would fuse them, without a network, and how good they are."""
