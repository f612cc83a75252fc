"""A benchmark leaves nothing behind, whether it ends by itself, by a signal or by a crash."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from deploy.spec import SwarmSpec, factory_robots, make_spec
from research.benchmarks import live
from tests.support.deploy_support import WAIT_S, await_, network_of, networks_in_use, processes_of
from tests.support.paths import REPOSITORY

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
SWARM = "bench-ending"
BENCHMARK = f"""
import time
from research.benchmarks.live import live_swarm
from deploy.spec import factory_robots

with live_swarm({SWARM!r}, {{}}, robots=factory_robots(2), rings=16) as state:
    print(state.spec.run_dir, flush=True)
    time.sleep(600)
"""
RUNNER = f"""
import subprocess, sys
from research.benchmarks.ending import adopt, end_adopted

adopt()
process = subprocess.Popen([sys.executable, "-c", {BENCHMARK!r}], stdout=subprocess.PIPE, text=True)
print(process.pid, process.stdout.readline(), sep="\\n", end="", flush=True)
process.wait()
print(len(end_adopted()), flush=True)
"""
STARTED_S = 200.0

needs_namespaces = pytest.mark.skipif(live.why_not() is not None, reason=str(live.why_not()))


@contextmanager
def program(text: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=STARTED_S)


def spec_of(run_dir: str) -> SwarmSpec:
    return make_spec(swarm=SWARM, robots=factory_robots(2), run_dir=run_dir)


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def networks_of(spec: SwarmSpec) -> set[str]:
    """The network namespaces of a swarm that runs."""
    mark = f"COADAPT_SWARM={spec.swarm}\0"
    found = set()
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark in (entry / "environ").read_text(errors="replace"):
                found.add(network_of(int(entry.name)))
    return found


@needs_namespaces
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_makes_a_benchmark_take_its_swarm_down(number: signal.Signals) -> None:
    with program(BENCHMARK) as process:
        spec = spec_of(line_of(process))
        networks = networks_of(spec)
        assert len(networks) == 3, "two robots' and the supervisor's"
        process.send_signal(number)
        assert process.wait(WAIT_S) == 128 + number
    assert not processes_of(spec)
    assert not Path(spec.run_dir).exists()
    await_(lambda: not networks & networks_in_use(), "the swarm's namespaces are gone")


@needs_namespaces
def test_what_a_killed_benchmark_left_is_ended_by_who_ran_it() -> None:
    with program(RUNNER) as process:
        benchmark = int(line_of(process))
        spec = spec_of(line_of(process))
        networks = networks_of(spec)
        os.kill(benchmark, signal.SIGKILL)
        assert int(line_of(process)) > 0
        assert not processes_of(spec)
        shutil.rmtree(Path(spec.run_dir).parent)
    await_(lambda: not networks & networks_in_use(), "the swarm's namespaces are gone")


def test_a_benchmark_that_fails_does_not_hide_the_others(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "research.benchmarks", "is_not_there", "report"],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "failed: is_not_there\n" in done.stderr
    run = json.loads((tmp_path / "build/bench/run.json").read_text())
    assert run["failed"] == ["is_not_there"]
    assert [(row["name"], row["status"]) for row in run["rows"]] == [
        ("is_not_there", 1),
        ("report", 0),
    ]


def test_a_report_tells_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from research.benchmarks.report import write_report

    monkeypatch.chdir(tmp_path)
    machine = json.loads(write_report("some", {}, {}).read_text())["machine"]
    assert machine["cores"] >= machine["cores_usable"] >= 1
    announced = Path("/proc/cpuinfo").read_text().split()
    assert set(machine["instruction_sets"]) <= set(announced)
