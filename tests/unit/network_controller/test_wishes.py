"""Layers of shapes: what was there at the start, what stays, what expires."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from network_controller.model import Link
from network_controller.wishes import TRACE_FLOOR_BPS, Wish, Wishes
from swarm.errors import NetworkError

CELL = Link("R1", "down")
S = 1_000_000_000


def wish(rate_bps: int, **fields: Any) -> Wish:
    values: dict[str, Any] = {
        "robot": "R1",
        "direction": "down",
        "layer": "stays",
        "kind": "rate",
        "operator": "anna",
        "since_ns": 0,
        "rates_bps": (rate_bps,),
    }
    return Wish(**(values | fields))


def rate(wishes: Wishes) -> int | None:
    top = wishes.get(CELL)
    return None if top is None else top.rate_bps(0)


def test_what_expires_lies_over_what_stays_and_that_over_the_start() -> None:
    wishes = Wishes(None, 0)
    wishes.put(wish(1_000_000, layer="start"))
    wishes.put(wish(2_000_000))
    wishes.put(wish(3_000_000, layer="expires", until_ns=10 * S))
    assert rate(wishes) == 3_000_000
    assert [w.rates_bps for w in wishes.expire(10 * S)] == [(3_000_000,)]
    assert rate(wishes) == 2_000_000
    wishes.drop(CELL)
    assert rate(wishes) == 1_000_000


def test_nothing_is_left_of_a_link_that_only_an_operator_shaped() -> None:
    wishes = Wishes(None, 0)
    wishes.put(wish(2_000_000, layer="expires", until_ns=10 * S))
    assert wishes.expire(10 * S - 1) == ()
    wishes.expire(10 * S)
    assert list(wishes) == []


def test_a_shape_that_stays_ends_the_one_that_would_expire() -> None:
    wishes = Wishes(None, 0)
    wishes.put(wish(3_000_000, layer="expires", until_ns=10 * S))
    wishes.put(wish(2_000_000))
    assert rate(wishes) == 2_000_000


def test_changes_can_be_taken_back() -> None:
    wishes = Wishes(None, 0)
    wishes.put(wish(1_000_000))
    before = wishes.copy()
    wishes.put(wish(2_000_000))
    wishes.drop(CELL)
    wishes.restore(before)
    assert rate(wishes) == 1_000_000


def test_operators_shapes_are_there_after_a_restart_without_what_has_expired(
    tmp_path: Path,
) -> None:
    path = tmp_path / "net" / "shapes.json"
    wishes = Wishes(path, 0)
    wishes.put(wish(1_000_000, layer="start"))
    wishes.put(wish(2_000_000))
    wishes.put(wish(4_000_000, robot="R2", layer="expires", until_ns=10 * S))
    wishes.changed()
    again = Wishes(path, 10 * S)
    assert again.revision == 1
    assert [(w.robot, w.layer) for w in again] == [("R1", "stays")]


def test_a_file_that_is_no_record_is_named(tmp_path: Path) -> None:
    path = tmp_path / "shapes.json"
    path.write_text("{}")
    with pytest.raises(NetworkError, match=r"shapes\.json"):
        Wishes(path, 0)


def test_a_record_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "net").write_text("in the way")
    with pytest.raises(NetworkError, match="cannot be kept"):
        Wishes(tmp_path / "net" / "shapes.json", 0).changed()


def test_a_recorded_outage_is_slow_and_not_an_end() -> None:
    outage = wish(0, kind="trace", rates_bps=(5_000_000, 0))
    assert outage.rate_bps(1 * S) == TRACE_FLOOR_BPS
    assert outage.next_change_ns(0) == 1 * S


def test_expiry_is_a_change_to_look_at() -> None:
    assert wish(1_000_000, layer="expires", until_ns=7 * S).next_change_ns(0) == 7 * S
    assert wish(1_000_000).next_change_ns(0) == float("inf")
