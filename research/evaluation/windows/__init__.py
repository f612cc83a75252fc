"""Control windows of scenarios: what an ego would know, and what each choice would bring."""
