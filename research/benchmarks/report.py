"""Writes the JSON file of one benchmark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from research.evaluation.machine import machine_facts


def write_report(name: str, figures: dict[str, Any], samples: dict[str, Any]) -> Path:
    """Writes build/bench/<name>.json: figures at the top level, then `machine` and `samples`."""
    path = Path("build/bench") / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    report = {**figures, "machine": machine_facts(), "samples": samples}
    path.write_text(json.dumps(report, indent=1) + "\n")
    return path
