"""Oriented boxes from clusters of points; no learning."""

from perception.detector.config import DetectorConfig, ObjectClass, configuration
from perception.detector.detect import detect

__all__ = ["DetectorConfig", "ObjectClass", "configuration", "detect"]
