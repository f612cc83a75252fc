"""Who is asked in each frame of a drive, and who of them is heard in time."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from ego_agent.knowledge.compute import SINGLE, Work, packaged_compute
from ego_agent.knowledge.own_costs import LIGHTER
from research.evaluation.ways.drive import Driven, Focus
from research.evaluation.ways.planned import ALGORITHMS, Deciding
from research.evaluation.ways.remembered import Rehearsal
from research.evaluation.ways.way import Way
from research.evaluation.windows.announcements import snapshot
from research.evaluation.windows.links import Link
from research.evaluation.windows.played import play
from research.evaluation.windows.timing import Conditions, Played
from research.evaluation.windows.traffic import control_bps, left_bps


@dataclass(frozen=True, slots=True)
class _Asked:
    """What is asked for in one frame."""

    forms: Mapping[str, str]
    places: Mapping[str, Focus]
    """What those are asked about that are not asked for everything."""
    sizes: Mapping[str, int]
    """Bytes of what each sends, with those of asking for it."""
    taking_part: int


@dataclass(frozen=True, slots=True)
class Going:
    """One frame, as it went."""

    came: Mapping[str, str]
    """Who is in it, and with what."""
    places: Mapping[str, Focus]
    """What those of them were asked about that were not asked for everything."""
    sizes: list[int]
    """Bytes of all that robots sent, in time or not, with those of asking for it."""
    wanted_bytes: int
    """The same of all that was asked for."""
    asked: int
    """Robots that it could have had."""
    taking_part: int
    """Robots that the decision names, or the way; of these, those in range."""
    ego_ms: float
    """The ego's work, by the model of compute."""
    helping_ms: float
    """What of that is for contributions, and the work of the robots that sent them."""


def gone(driven: Driven, way: Way) -> list[Going | None]:
    """The frames of a drive as they go; None for one that is skipped.

    Where the way has a link, the drive is played (windows/played.py): robots need time to encode,
    the link for what they send beside control traffic, and the ego to fuse.
    """
    asked = _asked(driven, way)
    works = [
        {
            robot: _work(driven, form, robot in one.places and bool(one.places[robot].places))
            for robot, form in one.forms.items()
        }
        for one in asked
    ]
    sizes = [one.sizes for one in asked]
    played = _played(driven, way, way.link, sizes, works) if way.link is not None else None
    going: list[Going | None] = []
    for number, here in enumerate(asked):
        sent, came = [*here.forms], [*here.forms]
        if played is not None:
            one = played.frames[number]
            if one is None:
                going.append(None)
                continue
            came = [*one.in_time]
            sent = [
                robot for robot in here.forms if one.missing.get(robot) not in ("busy", "refused")
            ]
        going.append(
            Going(
                {robot: form for robot, form in here.forms.items() if robot in came},
                {robot: where for robot, where in here.places.items() if robot in came},
                [here.sizes[robot] for robot in sent],
                sum(here.sizes.values()),
                len(here.forms),
                here.taking_part,
                _ego_ms(driven, [works[number][robot] for robot in came]),
                sum(works[number][robot].add_ms for robot in came)
                + sum(works[number][robot].encode_ms for robot in sent),
            )
        )
    return going


def _ego_ms(driven: Driven, taken: Sequence[Work]) -> float:
    """The ego's work for a frame with those contributions."""
    fixed_ms = max((work.fixed_ms for work in taken), default=_work(driven, SINGLE).fixed_ms)
    return fixed_ms + sum(work.add_ms for work in taken)


def _asked(driven: Driven, way: Way) -> list[_Asked]:
    """By frame."""
    deciding = _deciding(driven, way)
    # Where poses are right, everybody is placed.
    learns = deciding is not None and driven.drive.pose_noise_m > 0.0
    rehearses = learns or (way.memory and way.asks_about_places)
    rehearsal = Rehearsal(driven, way.max_error_m) if rehearses else None
    rate_hz = driven.world.rate_hz
    asked: list[_Asked] = []
    for number, frame in enumerate(driven.frames):
        objects: Collection[str]
        if deciding is None:
            near = driven.in_range(frame)
            objects = way.objects(number, driven.nearest, rate_hz)
            whole = _only(near, way.asked(number, driven.nearest, rate_hz))
            about = _only(near, way.asked_about(number, driven.nearest, rate_hz))
            named = driven.nearest if way.forms else [one.robot for one in way.assignments]
            taking_part = len({*named} & {*near})
        else:
            whole, about = deciding.asked(number, frame), deciding.asked_about(number)
            objects = deciding.objects(number)
            taking_part = len(deciding.participants)
        only: Mapping[str, Focus] = {}
        if rehearsal is not None:
            only = rehearsal.ask(frame, whole, about if way.memory else {}, objects)
            if deciding is not None:
                deciding.heed(rehearsal.placed)
        forms = {**whole, **{r: about[r] for r, one in only.items() if one.places}}
        sizes = {
            robot: driven.size(frame, robot, form, way.max_error_m, only.get(robot))
            for robot, form in forms.items()
        }
        if deciding is not None:
            deciding.receive(forms, sizes, only)
        asked.append(_Asked(forms, only, sizes, taking_part))
    return asked


def _only(robots: Collection[str], asked: Mapping[str, str]) -> Mapping[str, str]:
    return {robot: form for robot, form in asked.items() if robot in robots}


def _deciding(driven: Driven, way: Way) -> Deciding | None:
    """None where it is always asked for the same."""
    if way.decided is None:
        return None
    link, from_s = way.link, way.link_from_s
    assert link is not None, f"{way.name}: what is decided depends on a link"
    return Deciding(driven, way.decided, lambda at_s: link.known_bps(from_s + at_s))


def _played(
    driven: Driven,
    way: Way,
    link: Link,
    sizes: Sequence[Mapping[str, int]],
    works: Sequence[Mapping[str, Work]],
) -> Played:
    begin_s = way.link_from_s
    messages = driven.heard(driven.frames[0], ALGORITHMS)
    control = control_bps(snapshot(driven.ego, messages, link.known_bps(begin_s)))

    def size(robot: str, number: int) -> int:
        return sizes[number][robot]

    conditions = Conditions(
        work=_work(driven, SINGLE),
        cell_bps=lambda at_s: left_bps(link.rate_bps(begin_s + at_s), control),
        period_s=1.0 / driven.world.rate_hz,
        asked=works,
    )
    robots = [robot for robot in driven.world.robots if robot != driven.ego]
    return play(robots, len(driven.frames), size, conditions)


def _work(driven: Driven, algorithm: str, about_places: bool = False) -> Work:
    usual = packaged_compute().work(driven.world.detector, algorithm)
    return replace(usual, add_ms=LIGHTER * usual.add_ms) if about_places else usual
