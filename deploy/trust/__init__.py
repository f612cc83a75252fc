"""The certificates of a swarm: its authority, who gets one, and their renewal."""
