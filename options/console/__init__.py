"""The operator's console: one web page that shows a running swarm, and steers its links."""
