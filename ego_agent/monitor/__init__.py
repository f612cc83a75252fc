"""Monitor: what the ego knows of every robot, and what its link carries."""
