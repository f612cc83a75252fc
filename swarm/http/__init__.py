"""HTTP servers of the swarm's processes: who may ask, how places are shared, events."""
