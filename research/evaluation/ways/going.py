"""Who is asked in each frame of a drive, and who of them is heard in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ego_agent.knowledge.compute import SINGLE, Work, packaged_compute
from research.evaluation.ways.drive import Driven
from research.evaluation.ways.planned import ALGORITHMS, Deciding
from research.evaluation.ways.way import Way
from research.evaluation.windows.announcements import snapshot
from research.evaluation.windows.links import Link
from research.evaluation.windows.played import play
from research.evaluation.windows.timing import Conditions, Played
from research.evaluation.windows.traffic import control_bps, left_bps


@dataclass(frozen=True, slots=True)
class Going:
    """One frame, as it went."""

    came: Mapping[str, str]
    """Who is in it, and with what."""
    sizes: list[int]
    """Bytes of all that robots sent, in time or not, with those of asking for it."""
    wanted_bytes: int
    """The same of all that was asked for."""
    asked: int
    """Robots that it could have had."""
    taking_part: int
    """Robots that the decision names."""
    ego_ms: float
    """The ego's work, by the model of compute."""


def gone(driven: Driven, way: Way) -> list[Going | None]:
    """The frames of a drive as they go; None for one that is skipped.

    Where the way has a link, the drive is played (windows/played.py): robots need time to encode,
    the link for what they send beside control traffic, and the ego to fuse.
    """
    asked, taking_part = _asked(driven, way)
    works = [{robot: _work(driven, form) for robot, form in one.items()} for one in asked]
    played = _played(driven, way, way.link, asked, works) if way.link is not None else None
    going: list[Going | None] = []
    for number, frame in enumerate(driven.frames):
        here = asked[number]
        sizes = {
            robot: driven.size(frame, robot, form, way.max_error_m) for robot, form in here.items()
        }
        sent, came = [*here], [*here]
        if played is not None:
            one = played.frames[number]
            if one is None:
                going.append(None)
                continue
            came = [*one.in_time]
            sent = [robot for robot in here if one.missing.get(robot) not in ("busy", "refused")]
        going.append(
            Going(
                {robot: here[robot] for robot in here if robot in came},
                [sizes[robot] for robot in sent],
                sum(sizes.values()),
                len(here),
                taking_part[number],
                _ego_ms(driven, [works[number][robot] for robot in came]),
            )
        )
    return going


def _ego_ms(driven: Driven, taken: Sequence[Work]) -> float:
    """The ego's work for a frame with those contributions."""
    fixed_ms = max((work.fixed_ms for work in taken), default=_work(driven, SINGLE).fixed_ms)
    return fixed_ms + sum(work.add_ms for work in taken)


def _asked(driven: Driven, way: Way) -> tuple[list[Mapping[str, str]], list[int]]:
    """By frame: who is asked for what, and how many take part."""
    rate_hz = driven.world.rate_hz
    if way.decided is None:
        asked = [way.asked(number, driven.nearest, rate_hz) for number in range(len(driven.frames))]
        everyone = len({robot for one in asked for robot in one})
        return asked, [everyone] * len(asked)
    link, from_s = way.link, way.link_from_s
    assert link is not None, f"{way.name}: what is decided depends on a link"
    deciding = Deciding(driven, way.decided, lambda at_s: link.known_bps(from_s + at_s))
    decided, taking_part = [], []
    for number, frame in enumerate(driven.frames):
        decided.append(deciding.asked(number, frame))
        taking_part.append(len(deciding.participants))
    return decided, taking_part


def _played(
    driven: Driven,
    way: Way,
    link: Link,
    asked: Sequence[Mapping[str, str]],
    works: Sequence[Mapping[str, Work]],
) -> Played:
    begin_s = way.link_from_s
    messages = driven.heard(driven.frames[0], ALGORITHMS)
    control = control_bps(snapshot(driven.ego, messages, link.known_bps(begin_s)))

    def size(robot: str, number: int) -> int:
        form = asked[number][robot]
        return driven.size(driven.frames[number], robot, form, way.max_error_m)

    conditions = Conditions(
        work=_work(driven, SINGLE),
        cell_bps=lambda at_s: left_bps(link.rate_bps(begin_s + at_s), control),
        period_s=1.0 / driven.world.rate_hz,
        asked=works,
    )
    robots = [robot for robot in driven.world.robots if robot != driven.ego]
    return play(robots, len(driven.frames), size, conditions)


def _work(driven: Driven, algorithm: str) -> Work:
    return packaged_compute().work(driven.world.detector, algorithm)
