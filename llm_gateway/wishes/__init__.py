"""Turns a person's words into an intent: code finds and counts, a small model tells what is meant,
and code that does not trust the model checks it."""

from llm_gateway.wishes.understand import RULES, Reader, understand

__all__ = ["RULES", "Reader", "understand"]
