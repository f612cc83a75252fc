"""The swarm on one machine in network namespaces: no container engine, no root."""
