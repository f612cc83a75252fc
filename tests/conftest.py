"""Fixtures that several test files share."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import pytest
from hypothesis import settings

from swarm.errors import WorldError
from tests.support.zenoh_fixtures import (  # noqa: F401
    open_session,
    own_router,
    pair,
    shared_router,
    swarm_name,
)
from worlds.sample import opv2v_sample

pytest_plugins = ["tests.support.first_hour"]

# A busy machine is no failure: no test judges a time.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

BEGUN = pytest.StashKey[float]()
"""When the run began, by the steady clock."""
WAITING_PART = 0.75
"""Of a run, the part in which files come that wait for other processes."""
FRAMES = 16
"""Of real data: what the archive of the sample holds; `make data` brings more."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What a test's fixtures need is a mark, by which `make test` leaves it out. Files that wait
    take turns with those that compute, for the sake of runs with several processes."""
    items.sort(key=_turns([item.path for item in items]))
    for item in items:
        names = getattr(item, "fixturenames", ())
        if "opv2v_dir" in names:
            item.add_marker(pytest.mark.data)
        if "tokens" in names:
            item.add_marker(pytest.mark.model)


def _turns(paths: Sequence[Path]) -> Callable[[pytest.Item], float]:
    """Where each test's file comes: files of `tests/unit`, which compute, evenly over the run; the
    others, which mostly wait, over the first part of it, so that none is waited for at the end."""
    kinds: tuple[list[Path], list[Path]] = ([], [])
    for path in dict.fromkeys(paths):
        kinds["unit" not in path.parts].append(path)
    turn = {
        path: part * number / len(files)
        for files, part in zip(kinds, (1.0, WAITING_PART), strict=True)
        for number, path in enumerate(files)
    }
    return lambda item: turn[item.path]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--summary FILE` keeps how a run went."""
    parser.addoption("--summary", type=Path, help="write seconds and counts as JSON")


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Writes the counts, as the last line of a run has them."""
    path: Path | None = config.getoption("--summary")
    if path is None:
        return
    stats = terminalreporter.stats
    counts = {name: len(stats.get(name, ())) for name in ("passed", "failed", "error", "skipped")}
    counts["failed"] += counts.pop("error")
    seconds = round(time.monotonic() - config.stash[BEGUN], 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"seconds": seconds, **counts}) + "\n")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[BEGUN] = time.monotonic()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where $COADAPT_REQUIRE=all (as in CI) nothing may be missing but a peer's checkout: a skip
    is a failure."""
    report = yield
    _refuse_skip(report, of_peer=item.get_closest_marker("peer") is not None)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """So is that of a whole module; a peer's sets its `pytestmark` before it skips."""
    report = yield
    if report.skipped:
        _refuse_skip(report, of_peer=_is_of_peer(collector.path, report.call.excinfo))
    return report


def _is_of_peer(path: Path, skipped: pytest.ExceptionInfo[BaseException]) -> bool:
    """Whether the module that skipped as a whole had marked itself by then."""
    frames = [entry.frame for entry in skipped.traceback if entry.path == path]
    marks = frames[-1].f_globals.get("pytestmark", []) if frames else []
    return any(mark.name == "peer" for mark in (marks if isinstance(marks, list) else [marks]))


def _refuse_skip(report: pytest.TestReport | pytest.CollectReport, *, of_peer: bool) -> None:
    if report.skipped and not of_peer and os.environ.get("COADAPT_REQUIRE") == "all":
        report.outcome = "failed"
        report.longrepr = f"skipped where nothing may be missing: {report.longrepr}"


@pytest.fixture(scope="session")
def opv2v_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The OPV2V sample scenario (a folder with data_protocol.yaml), its first 16 frames."""
    try:
        whole = opv2v_sample()
    except WorldError as error:
        pytest.skip(str(error))
    target = tmp_path_factory.mktemp("opv2v") / whole.name
    for vehicle in (path for path in whole.iterdir() if path.is_dir()):
        (target / vehicle.name).mkdir(parents=True)
        for description in sorted(vehicle.glob("*.yaml"))[:FRAMES]:
            for file in (description, description.with_suffix(".pcd")):
                (target / vehicle.name / file.name).symlink_to(file)
    shutil.copy(whole / "data_protocol.yaml", target)
    return target
