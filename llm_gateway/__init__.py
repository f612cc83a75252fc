"""The LLM gateway: queues, batches and caches what egos ask of a language model."""
