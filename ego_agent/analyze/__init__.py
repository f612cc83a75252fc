"""Analyze: one unified scene from what all robots say they see."""
