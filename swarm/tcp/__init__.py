"""What the kernel tells of this process' TCP connections."""
