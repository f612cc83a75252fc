"""Advice of a language model: questions, what answers are worth, and the count of both."""
