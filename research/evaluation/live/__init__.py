"""The same scenarios through a real swarm: Zenoh, processes and tc instead of function calls."""
