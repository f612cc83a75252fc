"""A schedule follows from its seed, keeps faults apart that would hide each other, and is data."""

from __future__ import annotations

import msgspec
import pytest

from research.chaos.faults.registry import KINDS, KNOWN
from research.chaos.history import Fault
from research.chaos.schedule import CALM_S, schedule

ROBOTS = ("R2", "R3", "R4", "R5")
USUAL = [kind for name, kind in KINDS.items() if name not in KNOWN]


def of(seed: int, seconds: float = 90.0, count: int = 45) -> tuple[Fault, ...]:
    return schedule(seed, seconds, count, ROBOTS, USUAL)


def test_the_same_seed_gives_the_same_schedule() -> None:
    assert of(7) == of(7)
    assert of(7) != of(8)


def test_a_schedule_survives_json() -> None:
    text = msgspec.json.encode(of(3))
    assert msgspec.json.decode(text, type=tuple[Fault, ...]) == of(3)


@pytest.mark.parametrize("seed", range(20))
def test_the_usual_run_has_forty_faults_of_fifteen_kinds(seed: int) -> None:
    faults = of(seed)
    assert len(faults) >= 40
    assert len({fault.kind for fault in faults}) >= 15


@pytest.mark.parametrize("seed", range(20))
def test_two_faults_never_hold_one_part_at_once(seed: int) -> None:
    held: dict[str, list[tuple[float, float]]] = {}
    for fault in of(seed):
        kind = KINDS[fault.kind]
        until_s = fault.at_s + fault.lasts_s + kind.rest_s
        for part in (*kind.holds, *([fault.target] if fault.target else [])):
            assert all(until_s <= b or fault.at_s >= e for b, e in held.get(part, [])), part
            held.setdefault(part, []).append((fault.at_s, until_s))


def test_faults_end_early_enough_to_see_what_comes_back() -> None:
    for fault in of(1, seconds=60.0):
        assert 0.0 < fault.at_s <= 60.0 - CALM_S - fault.lasts_s


def test_faults_have_a_target_where_their_kind_has_one() -> None:
    for fault in of(2):
        assert (fault.target in ROBOTS) == KINDS[fault.kind].targets
        shortest, longest = KINDS[fault.kind].lasts_s
        assert shortest <= fault.lasts_s <= longest


def test_where_there_is_no_room_there_are_fewer() -> None:
    only = [KINDS["kill-router"]]
    assert 1 <= len(schedule(1, 40.0, 30, ROBOTS, only)) < 5
    assert schedule(1, CALM_S, 30, ROBOTS, only) == ()
