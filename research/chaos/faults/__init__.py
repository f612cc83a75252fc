"""What is done to a swarm: one file for each part of it that is hit."""
