"""A model that runs here, on the processor, in a process of its own."""
