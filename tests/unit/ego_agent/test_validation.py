from __future__ import annotations

from typing import Any

import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.choices.validation import MAX_REPAIRS, Unusable, validate
from swarm.messages import Decision, decode, encode
from tests.support.ego_scenes import NOW_NS, assert_valid, candidate, knowledge, proposal, scene

# 20 Mbit/s at 10 Hz with 80 % headroom: 200 kB a frame.
FLOOR = scene(
    candidate("E", range(20)),
    candidate("A", range(20, 40)),
    candidate("B", range(40, 50)),
    candidate("C", range(50, 52), sizes={"late": 500}),
    excluded={"D": "its beacon is 3.0 s old, at most 1.0 s is allowed"},
)


def check(
    wanted: Proposal, found: UnifiedScene = FLOOR, known: Knowledge | None = None
) -> tuple[Decision | None, tuple[str, ...]]:
    known = known or knowledge(lambda_link=0)
    result = validate(wanted, found, known, policy="test", cycle=3, now_ns=NOW_NS)
    if isinstance(result, Unusable):
        assert result.repairs[-1] == f"refused: {result.why}"
        return None, result.repairs
    assert_valid(result, found, known)
    assert decode(encode(result), Decision) == result
    return result, result.repairs


def narrow(bytes_a_frame: float) -> UnifiedScene:
    return scene(FLOOR.ego, *FLOOR.candidates, capacity_bps=bytes_a_frame * 8 * 10 / 0.8)


def test_a_sound_proposal_becomes_the_decision_unchanged() -> None:
    decision, repairs = check(proposal("E", "B", "A", algorithm="late"))
    assert decision is not None
    assert repairs == ()
    assert decision.participants == ("E", "A", "B")
    assert decision.algorithm == "late"
    assert (decision.source, decision.policy, decision.reason) == ("policy", "test", "because")
    assert (decision.cycle, decision.decided_ns) == (3, NOW_NS)
    assert decision.cost_bytes == 1_200
    own = 20 / 52
    assert decision.quality == pytest.approx(own + 0.9 * (50 / 52 - own))
    assert decision.valid


def test_the_ego_alone_is_a_sound_proposal() -> None:
    decision, repairs = check(proposal("E"), narrow(1))
    assert decision is not None
    assert decision.participants == ("E",)
    assert decision.cost_bytes == 0
    assert repairs == ()


@pytest.mark.parametrize(
    ("participants", "kept", "repair"),
    [
        (("A", "B"), ("E", "A", "B"), "added the ego"),
        (("A", "E", "B"), ("E", "A", "B"), "put the ego first"),
        (("E", "A", "A"), ("E", "A"), "dropped 'A': named twice"),
        (("E", "A", "E"), ("E", "A"), "dropped 'E': named twice"),
        (("E", "A", "ghost"), ("E", "A"), "dropped 'ghost': no such robot is known"),
        (("E", "A", "D"), ("E", "A"), "dropped 'D': its beacon is 3.0 s old"),
        (("E", "A", 7), ("E", "A"), "dropped a participant of type int: not a robot id"),
        (("E", "A", ["B"]), ("E", "A"), "of type list"),
        (("E", "A", "C"), ("E", "A"), "dropped C: the size of its early observation is not known"),
        ((), ("E",), "added the ego"),
    ],
)
def test_offenders_are_dropped_and_the_ego_is_put_first(
    participants: tuple[Any, ...], kept: tuple[str, ...], repair: str
) -> None:
    decision, repairs = check(proposal(*participants))
    assert decision is not None
    assert decision.participants == kept
    assert len(repairs) == 1
    assert repair in repairs[0]


@pytest.mark.parametrize("algorithm", ["intermediate", "magic", "", None, 3, "early\ud800"])
def test_an_algorithm_that_cannot_be_used_is_replaced_by_the_best_that_can(algorithm: Any) -> None:
    decision, repairs = check(proposal("E", "A", "B", algorithm=algorithm))
    assert decision is not None
    assert decision.algorithm == "early"
    assert "is not available: only early, late" in repairs[0]
    slow, _ = check(proposal("E", "A", "B", algorithm=algorithm), narrow(13_000))
    assert slow is not None
    assert slow.algorithm == "late"
    assert slow.participants == ("E", "A", "B")


def test_a_cheaper_algorithm_carries_all_where_the_named_one_does_not() -> None:
    decision, repairs = check(proposal("E", "A", "B"), narrow(5_000))
    assert decision is not None
    assert (decision.algorithm, decision.participants) == ("late", ("E", "A", "B"))
    assert repairs == ("took late fusion: early does not carry all that were named",)


def test_the_least_gain_a_byte_is_dropped_where_the_link_does_not_carry_all() -> None:
    decision, repairs = check(proposal("E", "B", "A"), narrow(13_000), knowledge(["early"]))
    assert decision is not None
    assert (decision.algorithm, decision.participants) == ("early", ("E", "A"))
    assert repairs == ("dropped B: its 12.0 kB a frame do not fit beside 12.0 of 13.0 kB",)


def test_what_costs_more_never_replaces_what_does_not_fit() -> None:
    decision, _ = check(proposal("E", "A", "B", algorithm="late"), narrow(700))
    assert decision is not None
    assert (decision.algorithm, decision.participants) == ("late", ("E", "A"))


@pytest.mark.parametrize(
    ("wanted", "found", "why"),
    [
        (proposal("D", "ghost"), FLOOR, "nobody of those it names can take part"),
        (proposal("E", "ghost"), FLOOR, "nobody of those it names can take part"),
        (proposal("E", "A"), narrow(100), "nobody of those it names fits the link"),
        (proposal("A", made_ns=NOW_NS - 11 * 10**9), FLOOR, "it is 11.0 s old, at most 10.0 s"),
        (Proposal("ABC", "late", "", "llm"), FLOOR, "participants 'ABC', not a list"),  # type: ignore[arg-type]
        (Proposal(None, "late", "", "llm"), FLOOR, "of type NoneType"),  # type: ignore[arg-type]
        (Proposal(("A",) * 2000, "late", "", "llm"), FLOOR, "2000 participants, at most 1024"),
        (None, FLOOR, "a proposal of type NoneType"),
        ({"participants": ["A"]}, FLOOR, "a proposal of type dict"),
    ],
)
def test_what_cannot_be_repaired_is_refused_with_the_reason(
    wanted: Any, found: UnifiedScene, why: str
) -> None:
    decision, repairs = check(wanted, found)
    assert decision is None
    assert why in repairs[-1]


def test_a_recent_proposal_is_not_stale() -> None:
    assert check(proposal("A", made_ns=NOW_NS - 9 * 10**9))[0] is not None


def test_text_from_outside_is_bounded_and_always_travels() -> None:
    names = tuple(f"ghost{i}\udc00" + "x" * 10_000 for i in range(500))
    wanted = Proposal((*names, "A"), "late", "\ud800" + "y" * 10_000, "rumour")  # type: ignore[arg-type]
    decision, repairs = check(wanted)
    assert decision is not None
    assert decision.source == "policy"
    assert len(repairs) == MAX_REPAIRS
    assert "source 'rumour' is unknown" in repairs[-1]
    assert any("more changes" in repair for repair in repairs)
    assert len(encode(decision)) < 20_000


def test_a_reason_that_is_no_text_is_left_out() -> None:
    decision, _ = check(Proposal(("A",), "late", None, "llm"))  # type: ignore[arg-type]
    assert decision is not None
    assert decision.reason == ""
    assert decision.source == "llm"


def test_a_decision_of_an_ego_that_is_not_confirmed_is_marked() -> None:
    found = scene(candidate("E"), excluded={"E": "no beacon of the ego has arrived"})
    decision, _ = check(proposal("E"), found)
    assert decision is not None
    assert not decision.valid


# At 10 Hz with 80 % headroom 12 kB need a link of 1.2 Mbit/s, 600 bytes one of 60 kbit/s.
NARROW = scene(
    candidate("E", range(20)),
    candidate("A", range(20, 40)),
    candidate("B", range(40, 50), capacity_bps=1e6),
)


def test_a_robot_is_not_asked_for_more_than_its_own_link_carries() -> None:
    decision, repairs = check(proposal("E", "B", algorithm="early"), NARROW)
    assert decision is not None
    assert (decision.participants, decision.algorithm) == (("E", "B"), "late")
    assert repairs == (
        "took late fusion: B: 12.0 kB a frame for early need 0.96 Mbit/s, "
        "its own link may carry 0.80",
    )


def test_what_a_robot_sends_to_other_egos_anyway_takes_nothing_more_of_its_link() -> None:
    narrow = candidate("B", range(40, 50), capacity_bps=1e6, shared=("early",))
    decision, repairs = check(proposal("E", "B", algorithm="early"), scene(NARROW.ego, narrow))
    assert decision is not None
    assert (decision.participants, decision.algorithm, repairs) == (("E", "B"), "early", ())
    # The ego's own cell carries it all the same.
    assert decision.cost_bytes == 12_000


def test_a_robot_behind_a_narrow_link_is_dropped_where_nothing_else_can_be_fused() -> None:
    decision, repairs = check(proposal("E", "A", "B"), NARROW, knowledge(("early",)))
    assert decision is not None
    assert decision.participants == ("E", "A")
    assert repairs == (
        "dropped B: 12.0 kB a frame for early need 0.96 Mbit/s, its own link may carry 0.80",
    )


def test_what_just_fits_a_robots_own_link_is_left_alone() -> None:
    wide = scene(NARROW.ego, candidate("B", range(40, 50), capacity_bps=1.2e6))
    decision, repairs = check(proposal("E", "B"), wide)
    assert decision is not None
    assert decision.algorithm == "early"
    assert repairs == ()
