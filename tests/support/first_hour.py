"""Keeps what tests have seen of the first hour of a new user: `--first-hour FILE`.

A test that shows a stumble gone says so, with the command that a user would type:

    @pytest.mark.stumble("bags of cars never fuse", command="make up WORLD=bag DATA=cars")

and a test that measures a figure tells it by the fixture `figure`: `figure("notebook_lines", 12)`.
The file holds `stumbles`, a list of objects with `stumble`, `command`, `tests` and `gone` (true
where all its tests have passed), and each figure by its name.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Figure = Callable[[str, float], None]

STUMBLE = "first_hour_stumble"
FIGURE = "first_hour_figure"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--first-hour", type=Path, help="keep stumbles and figures as JSON")


def pytest_runtest_setup(item: pytest.Item) -> None:
    for mark in item.iter_markers("stumble"):
        item.user_properties.append((STUMBLE, [mark.args[0], mark.kwargs["command"]]))


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Figure:
    """Tells a measured figure by its name."""

    def tell(name: str, value: float) -> None:
        request.node.user_properties.append((FIGURE, [name, value]))

    return tell


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Adds what this run has seen to the file: `make test-all` is two runs."""
    path: Path | None = config.getoption("--first-hour")
    if path is None:
        return
    told = json.loads(path.read_text()) if path.exists() else {"stumbles": []}
    stumbles = {entry["stumble"]: entry for entry in told["stumbles"]}
    reports = [
        report
        for how in ("passed", "failed", "skipped", "error")
        for report in terminalreporter.stats.get(how, ())
        if isinstance(report, pytest.TestReport)
    ]
    seen: dict[str, dict[str, Any]] = {}
    for report in reports:
        for name, value in report.user_properties:
            if name == FIGURE and isinstance(value, list):
                told[value[0]] = value[1]
            elif name == STUMBLE and isinstance(value, list):
                entry = seen.setdefault(
                    value[0],
                    {"stumble": value[0], "command": value[1], "tests": [], "gone": True},
                )
                if report.nodeid not in entry["tests"]:
                    entry["tests"].append(report.nodeid)
                entry["gone"] = entry["gone"] and report.passed
    stumbles |= seen
    told["stumbles"] = sorted(stumbles.values(), key=lambda entry: str(entry["stumble"]))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(told, indent=1) + "\n")
