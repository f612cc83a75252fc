"""The two costly steps of the comparison, a scenario's window at a time, on all cores."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from ego_agent.analyze import analyze
from ego_agent.knowledge import Knowledge
from evaluation.kept import Kept
from evaluation.windows import knowing
from evaluation.windows.choice import Choice, Outcome
from evaluation.windows.knowing import Heard
from evaluation.windows.measure import Window, packed, unpacked
from evaluation.windows.scenarios import Scenario
from evaluation.windows.search import explore
from evaluation.workers import each

MADE_FROM = (
    "ego_agent/analyze.py", "ego_agent/greedy.py", "ego_agent/grid.py", "ego_agent/merge.py",
    "ego_agent/scoring.py", "evaluation/cooperative.py", "evaluation/windows", "perception",
    "swarm", "worlds",
)  # fmt: skip
"""What decides messages and outcomes."""

Outcomes = dict[Choice, Outcome]
R = TypeVar("R")


@dataclass(frozen=True)
class Piece:
    """One control window."""

    scenario: Scenario
    window: int
    algorithms: tuple[str, ...]
    heard: Heard | None = None
    wanted: tuple[Choice, ...] = ()
    known: tuple[tuple[Choice, Outcome], ...] = ()

    @property
    def key(self) -> str:
        """By which results are kept."""
        return f"{self.scenario} window {self.window} {self.algorithms}"


def listen(pieces: Sequence[Piece], workers: int, kept: Kept) -> list[Piece]:
    """The pieces with what the ego has heard at the beginning of each window."""
    found: list[bytes | None] = [kept.get(f"heard {piece.key}") for piece in pieces]
    missing = [piece for piece, raw in zip(pieces, found, strict=True) if raw is None]
    fresh = _each(_listen, missing, workers, "messages")
    complete = []
    for piece, raw in zip(pieces, found, strict=True):
        if raw is None:
            raw = next(fresh)
            kept.put(f"heard {piece.key}", raw)
        complete.append(replace(piece, heard=knowing.unpacked(raw)))
    return complete


def measure(pieces: Sequence[Piece], workers: int, kept: Kept) -> list[Outcomes]:
    """The outcomes of the pieces' wanted choices and of the oracle's search, in order."""
    known = [unpacked(kept.get(f"outcomes {piece.key}") or []) for piece in pieces]
    missing = [
        replace(piece, known=tuple(outcomes.items()))
        for piece, outcomes in zip(pieces, known, strict=True)
        if not outcomes or any(choice not in outcomes for choice in piece.wanted)
    ]
    # Large swarms take longest: begun first, they do not keep one core busy at the end.
    missing.sort(key=lambda piece: -piece.scenario.robots)
    fresh = dict[str, Outcomes]()
    for piece, values in zip(missing, _each(_measure, missing, workers, "measured"), strict=True):
        kept.put(f"outcomes {piece.key}", values)
        fresh[piece.key] = unpacked(values)
    return [fresh.get(piece.key, outcomes) for piece, outcomes in zip(pieces, known, strict=True)]


def knowledge_of(algorithms: Sequence[str]) -> Knowledge:
    """What an ego knows beforehand: the objective, and the algorithms that it decides among."""
    return Knowledge(algorithms=algorithms)


def _listen(piece: Piece) -> bytes:
    window = Window(piece.scenario, piece.window)
    knowledge = knowledge_of(piece.algorithms)
    fusions = {name: window.fusion(name) for name in knowledge.algorithms}
    messages = knowing.heard(
        window.world,
        piece.scenario.decision_frame(piece.window),
        window.ego,
        dict(fusions),
        piece.scenario.pose_noise_m,
        knowledge.objective.comm_range_m + 1.0,
    )
    return knowing.packed(messages)


def _measure(piece: Piece) -> list[object]:
    window = Window(piece.scenario, piece.window, dict(piece.known))
    knowledge = knowledge_of(piece.algorithms)
    assert piece.heard is not None
    capacity_bps = piece.scenario.capacity_bps(piece.window)
    scene = analyze(knowing.snapshot(window.ego, piece.heard, capacity_bps), knowledge)
    explore(window, scene, knowledge, piece.wanted)
    return packed(window.outcomes)


def _each(
    work: Callable[[Piece], R], pieces: Sequence[Piece], workers: int, what: str
) -> Iterator[R]:
    """Results in order, with a line of progress each."""
    if not pieces:
        return
    begun = time.monotonic()
    detector = pieces[0].scenario.open().detector
    total = sum(piece.scenario.robots for piece in pieces)
    done = 0
    for number, (piece, result) in enumerate(
        zip(pieces, each(work, pieces, workers, detector), strict=True), 1
    ):
        done += piece.scenario.robots
        left_s = (time.monotonic() - begun) * (total - done) / done
        print(
            f"{what}: {number}/{len(pieces)} windows, {piece.scenario.name}, "
            f"about {left_s / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )
        yield result
