"""One target for some seconds: starts a worker, and tries its suspicions out."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from research.fuzz.limits import scratch
from research.fuzz.trial import Finding, try_out

_EXECUTED = re.compile(r"^stat::number_of_executed_units:\s*(\d+)", re.M)
_COVERED = re.compile(r"^#(\d+)\s+\w+\s+cov: (\d+) ft: (\d+)", re.M)
_STARTING_S = 120.0
"""By the clock, for a worker's start on a machine that is busy, and for its last input."""


@dataclass(frozen=True, slots=True)
class Hunt:
    """What came of fuzzing a target."""

    target: str
    executions: int
    seconds: float
    coverage: int
    """Edges of the code that inputs reached."""
    features: int
    """Edges by how often they were passed."""
    suspicions: int
    """Inputs that were tried out alone; those that did it again are the findings."""
    findings: dict[str, Finding] = field(default_factory=dict)
    """By the file that holds the input."""

    def count(self, kind: str) -> int:
        """How many findings are of a kind."""
        return sum(found.kind == kind for found in self.findings.values())

    def row(self) -> dict[str, Any]:
        """Its row in build/fuzz.json."""
        return {
            "target": self.target,
            "executions": self.executions,
            "seconds": round(self.seconds, 1),
            "coverage": self.coverage,
            "features": self.features,
            "suspicions": self.suspicions,
            "crashes": self.count("crash"),
            "hangs": self.count("hang"),
            "jumps": self.count("jump"),
            "findings": {path: asdict(found) for path, found in self.findings.items()},
        }


def hunt(
    name: str,
    place: str,
    seconds: float,
    seed: int,
    seeds: Path,
    build: Path,
    runs: int | None = None,
) -> Hunt:
    """Fuzzes the target at `place` (`module:NAME`).

    Args:
        name: of the target, and of its folders.
        place: where it lies.
        seconds: by the clock, with the worker's start.
        seed: of chance.
        seeds: the folder of the repository's corpus; it does not change.
        build: where `corpus` grows and `suspicions` come.
        runs: inputs at most; None: until the time is over.

    Raises RuntimeError with a worker's last words when it did not get to fuzz.
    """
    grown, suspicions = build / "corpus" / name, build / "suspicions" / name
    for folder in (grown, suspicions):
        folder.mkdir(parents=True, exist_ok=True)
    for old in suspicions.iterdir():
        old.unlink()
    began = time.monotonic()
    command = [sys.executable, "-m", "research.fuzz.worker", place, str(grown)]
    command += [str(seeds)] if seeds.is_dir() else []
    command += ["--seconds", str(seconds), "--seed", str(seed), "--suspicions", str(suspicions)]
    command += [] if runs is None else ["--runs", str(runs)]
    words = _words(command, seconds + _STARTING_S)
    took_s = time.monotonic() - began
    covered = _COVERED.findall(words)
    executed = _EXECUTED.search(words)
    if not covered and not executed:
        raise RuntimeError(f"the worker of target {name} did not start to fuzz: {words[-2000:]}")
    reached = covered[-1] if covered else ("0", "0", "0")
    found = {str(path): try_out(place, path) for path in sorted(suspicions.iterdir())}
    return Hunt(
        name,
        executions=int(executed[1] if executed else reached[0]),
        seconds=took_s,
        coverage=int(reached[1]),
        features=int(reached[2]),
        suspicions=len(found),
        findings={path: finding for path, finding in found.items() if finding is not None},
    )


def _words(command: list[str], timeout_s: float) -> str:
    """What a worker says. One that a hanging input holds is killed: it left that input behind, or
    the machine was so busy that it got no further."""
    try:
        with scratch() as settings:
            done = subprocess.run(
                command,
                env=settings,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=timeout_s,
                check=False,
            )
    except subprocess.TimeoutExpired as error:
        said = error.stderr or b""
        return said.decode(errors="replace") if isinstance(said, bytes) else said
    return done.stderr
