"""Competing telemetry: real flows in the background class, bounded in time."""
