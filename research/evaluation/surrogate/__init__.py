"""Training of the ego's surrogate: what choices brought on floors of its own."""
