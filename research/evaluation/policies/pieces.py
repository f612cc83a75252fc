"""The two costly steps of the comparison, a scenario's window at a time, on all cores."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.objective import Objective
from perception.fusion.base import Fusion
from research.evaluation.kept import Kept
from research.evaluation.windows import knowing
from research.evaluation.windows.choice import Choice, Outcome
from research.evaluation.windows.knowing import Heard
from research.evaluation.windows.measure import NotMeasuredError, Window, packed, unpacked
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.windows.search import explore
from research.evaluation.workers import each
from swarm.errors import EvaluationError

MADE_FROM = (
    "research/evaluation/sharing.py",
    "research/evaluation/windows/frames.py", "research/evaluation/windows/knowing.py",
    "research/evaluation/windows/measure.py", "perception",
    "swarm/arrays.py", "swarm/geometry.py", "swarm/messages", "worlds",
)  # fmt: skip
"""What decides messages and outcomes, apart from what their keys name."""

Outcomes = dict[Choice, Outcome]
Place = tuple[str, int]
"""A scenario's name and the number of a window."""
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
    def place(self) -> Place:
        """Its scenario's name and its number."""
        return self.scenario.name, self.window

    def knowledge(self) -> Knowledge:
        """What the ego knows beforehand."""
        return knowledge_of(self.algorithms, self.scenario)

    def heard_key(self) -> str:
        """By which messages are kept."""
        frame, reach_m = self.scenario.decision_frame(self.window), _reach_m(self.scenario)
        return f"heard {self.scenario.setting()} {frame} {reach_m} {sorted(self.algorithms)}"

    def outcomes_key(self) -> str:
        """By which outcomes are kept."""
        frames = self.scenario.sampled_frames(self.window)
        return f"outcomes {self.scenario.setting()} {frames}"


def knowledge_of(algorithms: Sequence[str], scenario: Scenario) -> Knowledge:
    """What an ego knows beforehand: the objective, and the algorithms that it decides among."""
    return Knowledge(Objective(comm_range_m=scenario.comm_range_m), algorithms)


def listen(pieces: Sequence[Piece], workers: int, kept: Kept) -> list[Piece]:
    """The pieces with what the ego has heard at the beginning of each window."""
    found: list[bytes | None] = [kept.get(piece.heard_key()) for piece in pieces]
    missing = [at for at, raw in enumerate(found) if raw is None]
    for place, raw in _each(_listen, [pieces[at] for at in missing], workers, "messages"):
        found[missing[place]] = raw
        kept.put(pieces[missing[place]].heard_key(), raw)
    return [
        replace(piece, heard=knowing.unpacked(raw))
        for piece, raw in zip(pieces, found, strict=True)
        if raw is not None
    ]


def measure(pieces: Sequence[Piece], workers: int, kept: Kept) -> list[Outcomes]:
    """The outcomes of the pieces' wanted choices and of the oracle's search, in order.

    What was measured before is looked up; which of it counts does not depend on what there is.
    """
    pieces = [
        replace(piece, known=tuple(unpacked(kept.get(piece.outcomes_key()) or []).items()))
        for piece in pieces
    ]
    found = [_looked_up(piece) for piece in pieces]
    missing = [at for at, one in enumerate(found) if one is None]
    # Large swarms take longest: begun first, they do not keep one core busy at the end.
    missing.sort(key=lambda at: -pieces[at].scenario.robots)
    for place, (every, considered) in _each(
        _measure, [pieces[at] for at in missing], workers, "measured"
    ):
        piece = pieces[missing[place]]
        kept.put(piece.outcomes_key(), every)
        found[missing[place]] = unpacked(considered)
    return [one for one in found if one is not None]


def _reach_m(scenario: Scenario) -> float:
    """Robots farther away cannot be candidates, wherever noise puts them."""
    return scenario.comm_range_m + 10 * scenario.pose_noise_m + 1.0


def _listen(piece: Piece) -> bytes:
    window = Window(piece.scenario, piece.window)
    fusions: dict[str, Fusion] = {name: window.fusion(name) for name in piece.algorithms}
    messages = knowing.heard(
        window.world,
        piece.scenario.decision_frame(piece.window),
        window.ego,
        fusions,
        piece.scenario.pose_noise_m,
        _reach_m(piece.scenario),
    )
    return knowing.packed(messages)


def _looked_up(piece: Piece) -> Outcomes | None:
    """The outcomes that count, where all of them are known."""
    try:
        return _explored(
            Window(piece.scenario, piece.window, dict(piece.known), measures=False), piece
        )
    except NotMeasuredError:
        return None


def _measure(piece: Piece) -> tuple[list[Any], list[Any]]:
    """All outcomes that are known then, and those that count."""
    window = Window(piece.scenario, piece.window, dict(piece.known))
    considered = _explored(window, piece)
    return packed(window.outcomes), packed(considered)


def _explored(window: Window, piece: Piece) -> Outcomes:
    if piece.heard is None:
        raise EvaluationError(f"nothing was heard in {piece.place}")
    knowledge, known_bps = piece.knowledge(), piece.scenario.known_bps(piece.window)
    seen = knowing.snapshot(window.ego, piece.heard, known_bps)
    return explore(window, analyze(seen, knowledge), knowledge, piece.wanted)


def _each(
    work: Callable[[Piece], R], pieces: Sequence[Piece], workers: int, what: str
) -> Iterator[tuple[int, R]]:
    """Places and results as they are ready, with a line of progress each."""
    if not pieces:
        return
    begun = time.monotonic()
    detector = pieces[0].scenario.open().detector
    total = sum(piece.scenario.robots for piece in pieces)
    done = 0
    for number, (place, result) in enumerate(each(work, pieces, workers, detector), 1):
        yield place, result
        # Said when the caller has kept it.
        done += pieces[place].scenario.robots
        left_s = (time.monotonic() - begun) * (total - done) / done
        print(
            f"{what}: {number}/{len(pieces)} windows, {pieces[place].scenario.name}, "
            f"about {left_s / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )
