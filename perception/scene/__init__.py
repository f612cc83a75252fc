"""The Scene Abstraction Module: a scan as a structured description."""
