"""Oriented boxes from clusters of points; no learning."""

from perception.detector.config import Carrier, DetectorConfig, ObjectClass, configuration
from perception.detector.detect import detect

__all__ = ["Carrier", "DetectorConfig", "ObjectClass", "configuration", "detect"]
