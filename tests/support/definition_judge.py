"""Schemathesis makes requests from an OpenAPI document, and judges the answers by it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.support.paths import REPOSITORY

TOKEN = "definitions-token"
RIGHT = {"Authorization": f"Bearer {TOKEN}"}
EXAMPLES = 40
"""Requests of the kind that chance makes, for each operation; the systematic ones come on top."""


def judge(definition: str, url: str, folder: Path, hooks: str = "") -> dict[str, Any]:
    """Schemathesis' own report of a run against a server that wants `TOKEN`; `hooks` is a module
    that it loads."""
    report = folder / "report.json"
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "schemathesis.cli"),
            *("--config-file", str(REPOSITORY / "tests" / "support" / "schemathesis.toml")),
            *("run", definition, "--url", url, "--header", f"Authorization: Bearer {TOKEN}"),
            *("--checks", "all", "--max-examples", str(EXAMPLES), "--seed", "1"),
            *("--generation-database", "none", "--no-color"),
            *("--report", "json", "--report-json-path", str(report)),
        ],
        cwd=folder,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), *sys.path])}
        | ({"SCHEMATHESIS_HOOKS": hooks} if hooks else {}),
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert report.exists(), ended.stdout[-2000:] + ended.stderr[-2000:]
    found: dict[str, Any] = json.loads(report.read_text())
    found["said"] = ended.stdout.partition("= FAILURES =")[2][:6000]
    return found


def hold(found: dict[str, Any], operations: int) -> None:
    """The run was whole, and has found nothing."""
    assert found["complete"]
    assert found["operations"]["tested"] == operations, found["operations"]
    assert found["test_cases"]["generated"] > 10 * operations
    assert not found["failures"], found["said"]
    assert not found["errors"], found["errors"]
