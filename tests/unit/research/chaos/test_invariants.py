"""Every invariant holds in a calm history, and is found broken in one that is made up for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import pytest

from research.chaos.history import (
    LET_IN,
    Cycle,
    DecisionArrival,
    Fault,
    Frame,
    History,
    Memory,
    Played,
    Seen,
)
from research.chaos.invariants import Broken, broken, during, gaps, hijacked
from research.chaos.recovery import recovery

BOUND = 4
ROBOTS = ("R2", "R3")


def cycle(number: int, **more: Any) -> Cycle:
    usual: dict[str, Any] = {
        "at_s": float(number),
        "cycle": number,
        "started_ns": number * 1_000_000_000,
        "valid": True,
        "cycle_ms": 5.0,
        "cost_bps": 1e6,
        "capacity_bps": 10e6,
        "participants": ("R1", *ROBOTS),
        "out": {},
    }
    return Cycle(**(usual | more))


def frame(at_s: float, **more: Any) -> Frame:
    usual: dict[str, Any] = {
        "at_s": at_s,
        "frame": int(10 * at_s),
        "participants": ("R1", *ROBOTS),
        "sizes": {"R2": 100, "R3": 100},
        "age_ms": 120.0,
        "late_ms": 3.0,
        "known_s": 0.2,
    }
    return Frame(**(usual | more))


def played(kind: str, begun_s: float, ended_s: float, **more: Any) -> Played:
    target = str(more.pop("target", ""))
    fault = Fault(kind=kind, target=target, at_s=begun_s, lasts_s=ended_s - begun_s, seed=1)
    usual: dict[str, Any] = {"up_s": ended_s, "hits": (target,) if target else ()}
    return Played(fault=fault, begun_s=begun_s, ended_s=ended_s, **(usual | more))


def history(cycles: Sequence[Cycle] | None = None, **more: Any) -> History:
    lines = [cycle(number) for number in range(30)] if cycles is None else cycles
    usual: dict[str, Any] = {
        "seconds": 30.0,
        "period_s": 1.0,
        "robots": ROBOTS,
        "cycles": tuple(lines),
        "decisions": tuple(
            DecisionArrival(at_s=c.at_s, cycle=c.cycle, decided_ns=c.started_ns) for c in lines
        ),
        "frames": tuple(frame(float(number)) for number in range(30)),
        "foreign_bytes": 4_999,
    }
    return History(**(usual | more))


def rules(seen: History) -> set[str]:
    return {one.rule for one in broken(seen, BOUND)}


def lines_with(at: range, **more: Any) -> list[Cycle]:
    return [cycle(number, **(more if number in at else {})) for number in range(30)]


def test_nothing_is_broken_in_a_calm_history() -> None:
    assert broken(history(), BOUND) == ()


def test_a_cycle_that_is_missing_while_the_ego_runs_is_missed() -> None:
    # The numbers go on: what is missing is time.
    lines = [cycle(n) for n in range(10)]
    lines += [cycle(n, at_s=n + 3.0) for n in range(10, 20)]
    seen = history(lines)
    assert gaps(seen) == ([(9.0, 3)], 0)
    assert rules(seen) == {"decision in every cycle"}


def test_a_cycle_that_is_missing_while_the_ego_is_down_is_not_missed() -> None:
    lines = [cycle(n) for n in range(10)]
    lines += [cycle(n, at_s=n + 3.0) for n in range(10, 20)]
    seen = history(lines, played=(played("kill-ego", 9.5, 9.5, up_s=13.0, ego_down=True),))
    assert gaps(seen) == ([], 3)
    assert rules(seen) == set()


def test_no_cycle_at_all_is_told() -> None:
    assert rules(history([])) == {"decision in every cycle"}


@pytest.mark.parametrize(
    ("more", "rule"),
    [
        ({"cycle_ms": 1_500.0}, "decision by its deadline"),
        ({"valid": False}, "valid decision"),
        ({"cost_bps": 11e6}, "no decision over the link"),
    ],
)
def test_a_bad_cycle_is_found(more: dict[str, Any], rule: str) -> None:
    assert rules(history(lines_with(range(12, 13), **more))) == {rule}


@pytest.mark.parametrize(("count", "found"), [(2, set()), (3, {"nobody else is hit"})])
def test_a_robot_that_is_out_for_long_without_a_fault_is_found(count: int, found: set[str]) -> None:
    assert rules(history(lines_with(range(12, 12 + count), out={"R3": "it has left"}))) == found


def test_a_cycle_in_which_the_ego_stood_still_may_be_long() -> None:
    seen = history(
        lines_with(range(12, 13), cycle_ms=3_000.0),
        played=(played("stop-ego", 12.1, 15.0, ego_down=True),),
    )
    assert rules(seen) == set()


def test_a_hole_in_the_journal_is_found() -> None:
    lines = [cycle(n, cycle=n + (n >= 15)) for n in range(30)]
    (found,) = broken(history(lines), BOUND)
    assert (found.rule, found.at_s) == ("journal without a hole", 15.0)


def test_a_decision_without_a_line_is_found_but_for_that_of_a_killed_ego() -> None:
    extra = DecisionArrival(at_s=14.9, cycle=15, decided_ns=5)
    heard = (*history().decisions, extra)
    assert rules(history(decisions=heard)) == {"journal without a hole"}
    killed = played("kill-ego", 15.0, 15.0, up_s=15.5, ego_down=True)
    assert rules(history(decisions=heard, played=(killed,))) == set()


def test_a_stranger_in_a_frame_is_found() -> None:
    seen = history(frames=(frame(3.0, participants=("R1", "X7")),))
    assert rules(seen) == {"no stranger's part"}
    assert len(hijacked(seen)) == 1


@pytest.mark.parametrize("more", [{"missing": {"R2": "rejected"}}, {"sizes": {"R2": 4_999}}])
def test_an_impostors_payload_is_found(more: dict[str, Any]) -> None:
    attack = played("impostor", 2.0, 5.0, target="R2")
    frames = (frame(3.0, **more),)
    assert rules(history(frames=frames, played=(attack,))) == {"no stranger's part"}
    assert rules(history(frames=frames)) == set(), "without an impostor it is the robot's own"


def test_an_impostor_that_is_refused_breaks_nothing() -> None:
    attack = played("impostor", 2.0, 5.0, target="R2")
    frames = (frame(3.0, participants=("R1", "R3"), sizes={}, missing={"R2": "impostor"}),)
    assert rules(history(frames=frames, played=(attack,))) == set()


@pytest.mark.parametrize("more", [{"late_ms": 5_000.0}, {"age_ms": 9_000.0}, {"known_s": 4.0}])
def test_what_is_stale_and_shown_as_fresh_is_found(more: dict[str, Any]) -> None:
    assert rules(history(frames=(frame(3.0, **more),))) == {"nothing stale as fresh"}


def test_recovery_counts_cycles_from_when_what_was_hit_is_there_again() -> None:
    fault = played("kill-robot", 10.2, 10.2, up_s=13.5, target="R2")
    seen = history(lines_with(range(11, 17), out={"R2": "left"}), played=(fault,))
    found = recovery(seen, fault)
    assert (found.cycles, found.seconds) == (3, pytest.approx(6.8))
    assert "back in bounded time" not in rules(seen)


def test_a_stranger_that_is_let_in_is_found() -> None:
    fault = played("garbage", 3.0, 5.0, seen=f"{LET_IN}: 1 sessions, 40 random messages")
    assert rules(history(played=(fault,))) == {"no stranger is let in"}
    refused = played("garbage", 3.0, 5.0, seen="without a certificate: refused")
    assert rules(history(played=(refused,))) == set()


@pytest.mark.parametrize(("ap_70", "found"), [(0.3, {"no worse than the ego alone"}), (0.4, set())])
def test_seeing_less_than_the_ego_alone_is_found(ap_70: float, found: set[str]) -> None:
    assert rules(history(seen=Seen(frames=30, ap_70=ap_70, ap_70_alone=0.4))) == found


def test_who_never_comes_back_is_found() -> None:
    fault = played("kill-robot", 10.2, 10.2, up_s=None, target="R2")
    seen = history(lines_with(range(11, 30), out={"R2": "left"}), played=(fault,))
    assert rules(seen) == {"back in bounded time"}


def test_who_is_back_too_late_is_found() -> None:
    fault = played("partition-robot", 10.0, 12.0, target="R2")
    seen = history(lines_with(range(11, 20), out={"R2": "its beacon is old"}), played=(fault,))
    assert "back in bounded time" in rules(seen)


def test_cycles_that_another_fault_disturbs_do_not_count() -> None:
    first = played("stop-robot", 10.0, 12.0, target="R2")
    other = played("mute-robot", 12.5, 17.5, target="R2")
    seen = history(lines_with(range(11, 19), out={"R2": "old"}), played=(first, other))
    found = recovery(seen, first)
    assert found.cycles == 1, "only the one between them, before the robot is left alone again"
    assert rules(seen) == set()


def test_a_fault_that_another_one_covers_to_the_end_is_not_judged() -> None:
    first = played("stop-robot", 10.0, 12.0, target="R2")
    other = played("mute-robot", 11.0, 29.0, target="R2", up_s=30.0)
    seen = history(lines_with(range(11, 30), out={"R2": "old"}), played=(first, other))
    assert recovery(seen, first).disturbed


def grown(mb_per_h: float, seconds: float) -> tuple[Memory, ...]:
    return tuple(
        Memory(at_s=t, service="ego", pid=7, rss_bytes=round(5e8 + mb_per_h * 1e6 * t / 3600))
        for t in range(0, int(seconds), 10)
    )


def test_memory_is_judged_in_long_runs_only() -> None:
    def seen(mb_per_h: float, seconds: float) -> set[str]:
        found: tuple[Broken, ...] = broken(
            msgspec.structs.replace(history(), seconds=seconds, memory=grown(mb_per_h, seconds)),
            BOUND,
        )
        return {one.rule for one in found}

    assert seen(300.0, 3_600.0) == {"memory does not grow"}
    assert seen(300.0, 90.0) == set()
    assert seen(0.0, 3_600.0) == set()


def test_what_is_broken_names_the_faults_that_lasted() -> None:
    seen = history(played=(played("stop-robot", 10.0, 12.0, target="R2"),))
    assert during(seen, 11.0) == "stop-robot R2"
    assert during(seen, 20.0) == "no fault"
