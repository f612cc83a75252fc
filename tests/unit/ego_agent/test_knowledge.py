from __future__ import annotations

import pytest

from ego_agent.knowledge.base import MAX_SERIES, PARTS_AGE_NS, CycleResult, Knowledge
from ego_agent.knowledge.quality import USUAL_GAINS, QualityModel
from swarm.errors import DecisionError
from tests.support.ego_scenes import NOW_NS

SECOND = 10**9


def test_without_an_algorithm_nothing_can_be_decided() -> None:
    with pytest.raises(DecisionError, match="no algorithm"):
        Knowledge(algorithms=[])


def test_an_algorithm_that_somebody_added_counts_like_a_way_to_fuse_features() -> None:
    assert QualityModel().gain("twice") == USUAL_GAINS["intermediate"]


def test_gains_rank_early_before_intermediate_before_late() -> None:
    assert USUAL_GAINS["early"] > USUAL_GAINS["intermediate"] > USUAL_GAINS["late"]
    assert Knowledge(algorithms=["late", "early"]).best_algorithm() == "early"
    assert Knowledge(algorithms=["late"]).best_algorithm() == "late"


def test_a_size_is_the_median_of_the_last_receipts() -> None:
    known = Knowledge(algorithms=["late"], receipts=3)
    for size in (1, 1, 1, 700, 500, 900):
        known.record_payload("R", "late", size, NOW_NS)
    assert known.payload_sizes("R", {"late": 5}, NOW_NS) == {"late": 700}
    assert known.payload_sizes("other", {"late": 5}, NOW_NS) == {"late": 5}


def test_old_receipts_give_way_to_what_the_beacon_announces() -> None:
    known = Knowledge(algorithms=["late"], receipt_max_age_s=2.0)
    known.record_payload("R", "late", 700, NOW_NS)
    assert known.payload_sizes("R", {"late": 5}, NOW_NS + 2 * SECOND) == {"late": 700}
    assert known.payload_sizes("R", {"late": 5}, NOW_NS + 3 * SECOND) == {"late": 5}


def test_after_the_clock_is_put_back_nothing_is_recent() -> None:
    known = Knowledge(algorithms=["late"])
    known.record_payload("R", "late", 700, NOW_NS)
    assert known.payload_sizes("R", {"late": 5}, NOW_NS - SECOND) == {"late": 5}


def test_who_sends_everything_when_asked_for_a_part_is_known_for_minutes() -> None:
    known = Knowledge(algorithms=["early"])
    known.record_payload("R", "early", 900, NOW_NS, focused=True)
    known.record_payload("R", "early", 800, NOW_NS, objects_only=True)
    for later_ns in (SECOND, 300 * SECOND):
        assert known.focused_sizes("R", NOW_NS + later_ns) == {"early": 900}
        assert known.object_sizes("R", NOW_NS + later_ns) == {"early": 800}
    assert known.focused_sizes("R", NOW_NS + 2 * PARTS_AGE_NS) == {}
    known.record_payload("R", "early", 100, NOW_NS + 300 * SECOND, focused=True)
    assert known.focused_sizes("R", NOW_NS + 301 * SECOND) == {"early": 100}, "the newest counts"


def test_what_is_kept_of_receipts_and_results_is_bounded() -> None:
    known = Knowledge(algorithms=["late"], results=2)
    for number in range(MAX_SERIES + 1):
        known.record_payload(f"R{number}", "late", 100, NOW_NS)
    assert known.payload_sizes("R0", {}, NOW_NS) == {}
    assert known.payload_sizes(f"R{MAX_SERIES}", {}, NOW_NS) == {"late": 100}
    for cycle in range(5):
        known.record_result(CycleResult(cycle, "late", ("E",), "policy", 0.5, 0, 0, 10, 4.0))
    assert [result.cycle for result in known.results()] == [3, 4]
