"""The table of what a wished place shifts: paired, beside its controls."""

from __future__ import annotations

import math

import pytest

from research.evaluation.focus import Floor, summary

NONE = {"seen": 0.5, "ap_there": math.nan, "ap_elsewhere": 0.6, "kb_a_frame": 2.0}


def floor(gain: float) -> Floor:
    wished = {**NONE, "seen": 0.5 + gain, "ap_elsewhere": 0.6 - gain}
    return {"docks": {"none": NONE, "place": wished, "another": NONE}}


def test_differences_are_paired_and_what_has_nothing_to_find_is_left_out() -> None:
    rows = {row["figure"]: row for row in summary({1: floor(0.1), 2: floor(0.3)})}
    assert rows["seen"]["place"] == pytest.approx(0.7)
    assert str(rows["seen"]["over_none"]).startswith("+0.200 [")
    assert str(rows["seen"]["over_another"]).startswith("+0.200 [")
    assert str(rows["ap_elsewhere"]["over_none"]).startswith("-0.200 [")
    assert rows["ap_there"]["count"] == 0
    assert rows["kb_a_frame"]["over_none"] == "+0.000 [+0.000, +0.000]"
