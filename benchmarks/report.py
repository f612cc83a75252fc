"""Writes the JSON file of one benchmark."""

from __future__ import annotations

import json
import os
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np


def machine_facts() -> dict[str, Any]:
    """What a reader needs to compare two runs: processor, cores, load, versions."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line for line in cpuinfo.read_text().splitlines() if "model name" in line]
        if names:
            model = names[0].split(":", 1)[1].strip()
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "load_1m": round(os.getloadavg()[0], 2),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "written_at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def write_report(name: str, figures: dict[str, Any], samples: dict[str, Any]) -> Path:
    """Writes build/bench/<name>.json: figures at the top level, then `machine` and `samples`."""
    path = Path("build/bench") / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    report = {**figures, "machine": machine_facts(), "samples": samples}
    path.write_text(json.dumps(report, indent=1) + "\n")
    return path
