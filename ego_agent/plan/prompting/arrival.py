"""What a language model is told of answers that come late: one line, and only where any do."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.table import Ranked
from swarm.messages import Algorithm

STEP = 20
"""Percent: what trembles less changes no prompt."""
FINE_STEP = 5
"""The same where the model has little else to go by: arrival counts in such steps."""
APART = 40
"""Percent by which a robot must differ from most to be named."""
MOST_NAMED = 4
"""Robots that are named for one algorithm, those that are late most often first."""


def arrival_line(scorer: Scorer, listed: Sequence[Ranked]) -> str:
    """By algorithm the percentage of answers in time that is usual, and the robots that differ;
    empty while everything comes in time."""
    robots = [entry.candidate.robot for entry in listed]
    told = [_told(scorer, robots, name) for name in scorer.knowledge.algorithms]
    if not robots or all(percent == 100 and not apart for _, percent, apart in told):
        return ""
    words = [
        f"{name} {percent}"
        + (f" ({', '.join(f'{robot} {own}' for own, robot in apart)})" if apart else "")
        for name, percent, apart in told
    ]
    return f"In time, percent: {', '.join(words)}. What comes late adds nothing.\n"


def usual_in_time(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> int:
    """The percentage of these robots' answers that usually comes in time, in steps of FINE_STEP;
    100 where there is nobody to ask."""
    chances = [scorer.in_time(robot, algorithm) for robot in robots]
    return FINE_STEP * round(100 * median(chances) / FINE_STEP) if chances else 100


def mostly_late(scorer: Scorer, algorithm: Algorithm) -> bool:
    """Whether half of the candidates' answers with it, or more, come late."""
    chances = [scorer.in_time(c.robot, algorithm) for c in scorer.scene.candidates]
    return bool(chances) and median(chances) < 0.5


def _told(
    scorer: Scorer, robots: Sequence[str], algorithm: Algorithm
) -> tuple[Algorithm, int, list[tuple[int, str]]]:
    chances = {robot: _percent(scorer.in_time(robot, algorithm)) for robot in robots}
    usual = _percent(median(chances.values()) / 100) if chances else 100
    apart = sorted((own, robot) for robot, own in chances.items() if abs(own - usual) >= APART)
    return algorithm, usual, apart[:MOST_NAMED]


def _percent(share: float) -> int:
    return STEP * round(100 * share / STEP)
