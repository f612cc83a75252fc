"""Teaches a small language model to read wishes: generated wishes, LoRA, a card."""
