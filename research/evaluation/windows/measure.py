"""Measures choices on the sampled frames of a control window, each once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ego_agent.knowledge.model import UnifiedScene
from perception.fusion.registry import make_fusion
from perception.metrics import Match, match, precision_of
from research.evaluation.sharing import RememberingFusion
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.frames import OnceWorld
from research.evaluation.windows.scenarios import Scenario
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import judge

IOUS = (0.3, 0.5, 0.7)


class NotMeasuredError(Exception):
    """An outcome that is not known yet."""


class Window:
    """One control window and the outcomes that are known of it."""

    def __init__(
        self,
        scenario: Scenario,
        index: int,
        known: Mapping[Choice, Outcome] | None = None,
        *,
        measures: bool = True,
    ) -> None:
        """`measures`: whether outcomes that are not known are measured; else asking for one raises
        NotMeasuredError."""
        self._measures = measures
        self.scenario = scenario
        self.index = index
        self.world = OnceWorld(scenario.open())
        self.ego = self.world.robots[scenario.ego]
        self.outcomes = dict(known or {})
        self._fusions: dict[str, RememberingFusion] = {}

    def outcome(self, choice: Choice) -> Outcome:
        """What the choice brings; the ego takes part always.

        Raises PerceptionError for an algorithm that the world's detector does not have, WorldError
        for an unknown robot.
        """
        if choice not in self.outcomes and not self._measures:
            raise NotMeasuredError
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
        fusion = SINGLE if choice.algorithm == ALONE else self.fusion(choice.algorithm)
        noise = Disturbance(pose_noise_m=self.scenario.pose_noise_m)
        matches: list[list[Match]] = [[] for _ in IOUS]
        frames = self.scenario.sampled_frames(self.index)
        sent = 0
        for frame in frames:
            fused = fuse_frame(self.world, frame, self.ego, choice.participants, fusion, noise)
            found, truth = judge(self.world, frame, self.ego, fused.boxes)
            for of_iou, iou in zip(matches, IOUS, strict=True):
                of_iou.append(match(found, truth, iou))
            sent += sum(fused.bytes.values())
        ap_30, ap_50, ap_70 = map(precision_of, matches)
        truths = sum(one.truths for one in matches[0])
        first, second = matches[2][::2], matches[2][1::2]
        halves = None
        if all(sum(one.truths for one in half) for half in (first, second)):
            halves = (precision_of(first), precision_of(second))
        return Outcome(ap_30, ap_50, ap_70, sent / len(frames), len(frames), truths, halves)


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
            **{**outcome, "halves": tuple(outcome["halves"]) if outcome["halves"] else None}
        )
        for participants, algorithm, outcome in values
    }


def candidates_of(scene: UnifiedScene) -> tuple[str, ...]:
    """The robots that a choice may name, nearest first."""
    return tuple(candidate.robot for candidate in scene.candidates)
