"""Who a process is on the network, and what it may do there."""
