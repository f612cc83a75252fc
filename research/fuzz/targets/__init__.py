"""The targets. A new one is a line here, and a folder of seeds in tests/fuzz/corpus."""

from __future__ import annotations

_HERE = "research.fuzz.targets"

TARGETS: dict[str, str] = {
    "answers": f"{_HERE}.answers:ANSWERS",
    "arrays": f"{_HERE}.messages:ARRAYS",
    "bags": f"{_HERE}.files:BAG_FILES",
    "boxes": f"{_HERE}.payloads:BOXES",
    "chat": f"{_HERE}.answers:CHAT",
    "chunks": f"{_HERE}.messages:CHUNKS",
    "features": f"{_HERE}.payloads:FEATURES",
    "fields": f"{_HERE}.messages:FIELDS",
    "journals": f"{_HERE}.files:JOURNALS",
    "keys": f"{_HERE}.messages:KEYS",
    "messages": f"{_HERE}.messages:MESSAGES",
    "points": f"{_HERE}.payloads:POINTS",
    "qod": f"{_HERE}.answers:QOD",
    "recordings": f"{_HERE}.files:RECORDINGS",
    "ros": f"{_HERE}.ros:ROS",
    "scans": f"{_HERE}.files:SCAN_FILES",
    "tables": f"{_HERE}.files:TABLE_FILES",
}
"""Where each target lies, by name. Importing one imports what it fuzzes."""
