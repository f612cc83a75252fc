"""Three machines (namespaces) joined by hand, a router on each: what passes whom, and a cut."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import pytest

from research.benchmarks import live
from research.benchmarks.machines import ANSWER_BYTES, ANSWERS
from research.benchmarks.stage import inside

CUT_S = 6.0
"""A robot that is away so long is out of decisions."""
REJOIN_CYCLES = 5
"""Two are usual; links that were tried again just before the healing take longer."""
MTU = 1300
"""Of the way from B once all else is known: less than B's machine takes it for."""

pytestmark = pytest.mark.skipif(live.why_not() is not None, reason=str(live.why_not()))


@pytest.fixture(scope="module")
def found() -> Mapping[str, Any]:
    """What happened on machines A, B and C with robots R2 and R5 on B, R3 on C, egos on A and C."""
    result: Mapping[str, Any] = inside(
        "research.benchmarks.machines", "--inside", "--cut", str(CUT_S), "--mtu", str(MTU)
    )
    return result


def test_what_two_machines_tell_each_other_passes_no_third(found: Mapping[str, Any]) -> None:
    whole = ANSWERS * ANSWER_BYTES
    assert found["mesh"]["A"] < 0.01 * whole
    assert min(found["mesh"]["B"], found["mesh"]["C"]) >= whole
    # The same look sees the detour, where there is one.
    assert found["star"]["A"] >= whole


def test_priority_is_marked_on_the_wire_between_machines(found: Mapping[str, Any]) -> None:
    assert found["marked"]
    assert found["dscp_kept"]


def test_a_robot_that_joins_by_hand_contributes(found: Mapping[str, Any]) -> None:
    assert set(found["join_s"]) == {"R2", "R3"}


def test_a_machine_that_is_cut_off_goes_on_with_its_own_and_comes_back(
    found: Mapping[str, Any],
) -> None:
    on_a, on_c = found["cut"]["R1"], found["cut"]["R4"]
    assert set(on_a["with_whom"]) == {"R1", "R2", "R5"}
    assert set(on_c["with_whom"]) == {"R4", "R3"}
    for ego in (on_a, on_c):
        assert ego["missed"] == 0
        assert 1 <= ego["rejoin_cycles"] <= REJOIN_CYCLES


def test_a_machine_whose_packets_do_not_fit_the_way_says_so(found: Mapping[str, Any]) -> None:
    told = re.fullmatch(r"packets of (\d+) bytes do not get through to (\S+), .*", found["narrow"])
    assert told is not None, found["narrow"]
    assert int(told[1]) > MTU
    assert told[2].startswith("10.77.0.")
