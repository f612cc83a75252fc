"""Measures choices on the sampled frames of a control window, each fused frame once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import Any

import numpy as np

from ego_agent.knowledge.model import UnifiedScene
from perception.fusion.registry import make_fusion
from perception.metrics import Match
from research.evaluation.sharing import RememberingFusion
from research.evaluation.windows.choice import ALONE, Choice, Delivered, Outcome
from research.evaluation.windows.frames import OnceWorld
from research.evaluation.windows.fused import IOUS, FusedFrame, FusedFrames, fused_frame
from research.evaluation.windows.links import WINDOW_S
from research.evaluation.windows.played import play
from research.evaluation.windows.precision import precision_of, shares
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.windows.timing import Conditions, Played, Timing
from research.evaluation.windows.traffic import left_bps
from worlds.cooperative.fusing import SINGLE


class NotMeasuredError(Exception):
    """An outcome that is not known yet."""


class Window:
    """One control window and what is known of its frames."""

    def __init__(
        self,
        scenario: Scenario,
        index: int,
        known: FusedFrames | None = None,
        *,
        timing: Timing | None = None,
        measures: bool = True,
    ) -> None:
        """`known`: frames that were fused before. `timing`: what the window is played with; without
        one outcomes tell nothing of time. `measures`: whether frames that are not known are
        measured; else needing one raises NotMeasuredError."""
        self._measures = measures
        self._timing = timing
        self.scenario = scenario
        self.index = index
        self.world = OnceWorld(scenario.open())
        self.ego = self.world.robots[scenario.ego]
        self.known = dict(known or {})
        self.outcomes: dict[Choice, Outcome] = {}
        self._fusions: dict[str, RememberingFusion] = {}

    def outcome(self, choice: Choice) -> Outcome:
        """What the choice brings; the ego takes part always.

        Raises PerceptionError for an algorithm that the world's detector does not have, WorldError
        for an unknown robot.
        """
        if choice not in self.outcomes:
            self.outcomes[choice] = self._measure(choice)
        return self.outcomes[choice]

    def fusion(self, algorithm: str) -> RememberingFusion:
        """The fusion of that name, which encodes each scan once."""
        if algorithm not in self._fusions:
            self._fusions[algorithm] = RememberingFusion(
                make_fusion(algorithm, self.world.detector)
            )
        return self._fusions[algorithm]

    def _measure(self, choice: Choice) -> Outcome:
        sampled = self.scenario.sampled_frames(self.index)
        complete = [self._frame(frame, choice) for frame in sampled]
        ap_30, ap_50, ap_70 = (
            precision_of([(one.matches[at], 1.0) for one in complete]) for at in range(len(IOUS))
        )
        sent = sum(sum(one.bytes.values()) for one in complete)
        truths = sum(one.matches[0].truths for one in complete)
        delivered = (
            self._delivered(choice, sampled, complete, self._timing) if self._timing else None
        )
        halves = _halves([[(one.matches[2], 1.0)] for one in complete])
        size = sent / len(sampled)
        return Outcome(
            ap_30=ap_30,
            ap_50=ap_50,
            ap_70=ap_70,
            bytes_per_frame=size,
            frames=len(sampled),
            ground_truth=truths,
            halves=halves,
            ap_70_with_known=precision_of([(one.with_known, 1.0) for one in complete]),
            delivered=delivered,
        )

    def _delivered(
        self, choice: Choice, sampled: Sequence[int], complete: Sequence[FusedFrame], timing: Timing
    ) -> Delivered:
        """Plays the window, and judges every frame that was fused: with those who were in time, by
        the scans of the nearest sampled frame. All sampled frames count alike."""
        numbers = [frame - self.scenario.decision_frame(self.index) for frame in sampled]
        work = timing.compute.work(self.world.detector, choice.algorithm or SINGLE)
        played = self._played(choice, numbers, complete, timing)
        fused = played.fused()
        shown: list[list[tuple[str, ...]]] = [[] for _ in numbers]
        for one in fused:
            shown[_nearest(numbers, one.number)].append(one.in_time)
        whole = [
            part or [played.shown_from(at).in_time] for part, at in zip(shown, numbers, strict=True)
        ]
        came = [
            [
                (
                    self._frame(frame, Choice.of(robots, choice.algorithm, self.ego)).matches[2],
                    weight,
                )
                for robots, weight in shares(part).items()
            ]
            for frame, part in zip(sampled, whole, strict=True)
        ]
        asked = len(choice.participants) * len(fused)
        return Delivered(
            ap_70=precision_of(list(chain(*came))),
            halves=_halves(came),
            bytes_per_frame=played.sent_bytes / len(played.frames),
            ego_ms_per_frame=float(np.mean([work.ego_ms(len(one.in_time)) for one in fused])),
            helping_ms_per_frame=work.encode_ms * len(choice.participants)
            + work.add_ms * float(np.mean([len(one.in_time) for one in fused])),
            capacity_bps=self._mean_bps(len(played.frames)),
            in_time_ratio=sum(len(one.in_time) for one in fused) / asked if asked else 1.0,
            fused_ratio=len(fused) / len(played.frames),
        )

    def _mean_bps(self, frames: int) -> float:
        """C(t) over the window."""
        step_s = WINDOW_S / frames
        begin_s = self.index * WINDOW_S
        rates = [self.scenario.link.rate_bps(begin_s + at * step_s) for at in range(frames)]
        return float(np.mean(rates))

    def _played(
        self, choice: Choice, numbers: Sequence[int], complete: Sequence[FusedFrame], timing: Timing
    ) -> Played:
        """The window with this choice. A payload is as large as in the nearest sampled frame."""
        begin_s = self.index * WINDOW_S
        link = self.scenario.link

        def size(robot: str, number: int) -> int:
            return complete[_nearest(numbers, number)].bytes[robot]

        conditions = Conditions(
            work=timing.compute.work(self.world.detector, choice.algorithm or SINGLE),
            cell_bps=lambda at_s: left_bps(link.rate_bps(begin_s + at_s), timing.control_bps),
            processors=timing.processors,
        )
        return play(choice.participants, self.scenario.window_frames, size, conditions)

    def _frame(self, frame: int, choice: Choice) -> FusedFrame:
        """The frame, fused with exactly this choice's participants."""
        key = (frame, choice)
        if key not in self.known:
            if not self._measures:
                raise NotMeasuredError
            fusion = SINGLE if choice.algorithm == ALONE else self.fusion(choice.algorithm)
            self.known[key] = fused_frame(
                self.world,
                frame,
                self.ego,
                choice.participants,
                fusion,
                self.scenario.pose_noise_m,
            )
        return self.known[key]


def _nearest(numbers: Sequence[int], number: int) -> int:
    """The place of the number that is nearest."""
    return min(range(len(numbers)), key=lambda at: abs(numbers[at] - number))


def _halves(frames: Sequence[Sequence[tuple[Match, float]]]) -> tuple[float, float] | None:
    """AP@0.7 of every other frame, and of the rest; None unless both hold true boxes."""
    first, second = list(chain(*frames[::2])), list(chain(*frames[1::2]))
    if not all(sum(one.truths for one, _ in half) for half in (first, second)):
        return None
    return precision_of(first), precision_of(second)


def packed(outcomes: Mapping[Choice, Outcome]) -> list[Any]:
    """What `unpacked` restores, as plain values."""
    return [
        [choice.participants, choice.algorithm, asdict(outcome)]
        for choice, outcome in outcomes.items()
    ]


def unpacked(values: list[Any]) -> dict[Choice, Outcome]:
    """The outcomes whose `packed` gave these values."""
    return {
        Choice(tuple(participants), algorithm): Outcome(
            **{
                **_with_halves(outcome),
                "delivered": outcome["delivered"]
                and Delivered(**_with_halves(outcome["delivered"])),
            }
        )
        for participants, algorithm, outcome in values
    }


def _with_halves(values: dict[str, Any]) -> dict[str, Any]:
    return {**values, "halves": tuple(values["halves"]) if values["halves"] else None}


def candidates_of(scene: UnifiedScene) -> tuple[str, ...]:
    """The robots that a choice may name, nearest first."""
    return tuple(candidate.robot for candidate in scene.candidates)
