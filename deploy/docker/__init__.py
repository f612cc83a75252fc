"""The Docker image and the compose project of a swarm."""
