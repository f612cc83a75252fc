"""What answers prompts: a server, an embedded model, or nothing."""
