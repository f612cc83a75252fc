"""The contract of a swarm: messages, key space, transport, settings, metrics and geometry.

This package file imports nothing, so that `swarm.geometry` and `swarm.errors` can be used
without Zenoh.
"""
