"""What an ego remembers of objects: tracks with identity, motion and existence."""
