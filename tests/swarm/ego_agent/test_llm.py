"""Policy `llm` against a real endpoint on a real router: adopted, held, refused, replaced."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from swarm.errors import GatewayCode, GatewayError
from swarm.messages import DecideAnswer, DecideRequest, Decision
from tests.support.ego_advice import (
    A,
    B,
    Ego,
    Gateway,
    Handler,
    answer,
    floor,
    meet,
    outcome,
    report,
    saying,
)
from tests.support.ego_scenes import candidate, scene
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker

Meet = Callable[..., tuple[Ego, Gateway]]


@pytest.fixture
def meeting(shared_router: RouterProcess, open_session: SessionMaker) -> Meet:
    """Makes an ego and a gateway that meet on the shared router."""

    def make(handler: Handler, **settings: float) -> tuple[Ego, Gateway]:
        return meet(open_session, shared_router.address, handler, **settings)

    return make


def adopted(decision: Decision) -> bool:
    return outcome(decision) == "adopted"


@pytest.mark.stumble(
    "a language model's sentence is the reason of a decision", command="make up LLM=embedded"
)
def test_advice_is_adopted_and_then_held(meeting: Meet) -> None:
    ego, gateway = meeting(saying("B", "A", reason="they see the rest"))
    first = ego.until(adopted)
    assert (first.source, first.policy, first.model) == ("llm", "llm", "tiny")
    assert (first.participants, first.algorithm) == (("E", "A", "B"), "early")
    # What is known comes first; the model's words are told as such.
    facts, words = first.reason.split(". ", 1)
    assert facts.startswith("The ego and 2 of ")
    assert "early fusion costs" in facts
    assert words == 'tiny says: "they see the rest"'
    assert report(first).state == "adopted"
    for _ in range(3):
        held = ego.cycle()
        assert (held.source, held.model) == ("hold", "tiny")
        assert held.reason.endswith(words)
        assert held.participants == first.participants
        assert report(held).state == "held"
        assert report(held).question == 1
    assert gateway.requests.next().ego == "E"
    assert gateway.requests.empty()


def test_what_the_gateway_remembered_is_source_cache(meeting: Meet) -> None:
    ego, _ = meeting(saying("A", "B", source="cache", hit="exact", age_s=60.0))
    assert ego.until(adopted).source == "cache"
    assert ego.cycle().source == "hold"


def test_a_model_that_thinks_keeps_nobody_waiting(meeting: Meet) -> None:
    think = threading.Event()

    def slowly(request: DecideRequest) -> DecideAnswer:
        think.wait()
        return answer(request, "A", "B")

    ego, gateway = meeting(slowly)
    asked = ego.until(lambda d: report(d).question == 1)
    assert (asked.source, report(asked).state) == ("fallback", "asked")
    gateway.requests.next()
    for _ in range(20):
        waiting = ego.cycle()
        assert (waiting.source, report(waiting).state) == ("fallback", "waiting")
        assert waiting.participants == ("E", "A", "B")
    assert gateway.requests.empty()
    think.set()
    assert ego.until(adopted).source == "llm"


def test_an_answer_after_the_deadline_counts_as_late(meeting: Meet) -> None:
    think = threading.Event()

    def slowly(request: DecideRequest) -> DecideAnswer:
        think.wait()
        return answer(request, "A", "B")

    ego, _ = meeting(slowly, llm_deadline_s=0.3)
    late = ego.until_answered()
    think.set()
    assert (outcome(late), late.source) == ("late", "fallback")


def test_advice_that_is_worse_than_the_fallback_is_refused_for_this_scene(meeting: Meet) -> None:
    ego, gateway = meeting(saying("A"))
    refused = ego.until_answered()
    assert (outcome(refused), refused.source) == ("worse", "fallback")
    assert refused.participants == ("E", "A", "B")
    assert refused.repairs == (
        "refused: predicted quality 0.667, the fallback has 1.000 and reaches 0.700",
    )
    again = ego.cycle()
    assert (again.source, again.repairs) == ("fallback", refused.repairs)
    assert report(again).state == "refused"
    gateway.requests.next()
    assert gateway.requests.empty()


def test_advice_may_be_worse_by_the_margin_and_no_more(meeting: Meet) -> None:
    few = candidate("B", range(40, 41), distance_m=20.0)
    for margin, expected in ((0.05, "adopted"), (0.001, "worse")):
        ego, gateway = meeting(saying("A"), llm_value_margin=margin)
        ego.scene = floor(A, few)
        assert outcome(ego.until_answered()) == expected
        gateway.kill()


def test_a_model_that_does_not_trust_itself_is_refused(meeting: Meet) -> None:
    ego, _ = meeting(saying("A", "B", confidence=30), llm_min_confidence=0.5)
    refused = ego.until_answered()
    assert (outcome(refused), refused.source) == ("low_confidence", "fallback")
    assert "0.30" in refused.repairs[0]
    assert "0.50" in refused.repairs[0]


@pytest.mark.parametrize("text", ["", "I would take A.", "[]", '{"helpers": 3}', "[" * 5000])
def test_what_cannot_be_read_is_refused(meeting: Meet, text: str) -> None:
    def babble(request: DecideRequest) -> DecideAnswer:
        return DecideAnswer(request=request.request, decision=text, source="llm", model="tiny")

    ego, _ = meeting(babble)
    refused = ego.until_answered()
    assert (outcome(refused), refused.source) == ("unreadable", "fallback")


@pytest.mark.parametrize(
    "code", ["expired", "busy", "unavailable", "failed", "invalid", "too_large"]
)
def test_a_refusal_of_the_gateway_is_counted_by_its_code(meeting: Meet, code: GatewayCode) -> None:
    def refuse(request: DecideRequest) -> DecideAnswer:
        raise GatewayError(code, "not now")

    ego, _ = meeting(refuse)
    refused = ego.until_answered()
    assert (outcome(refused), refused.source) == (code, "fallback")
    assert f"{code}: not now" in refused.repairs[0]


def test_a_fault_within_the_gateway_is_a_failure(meeting: Meet) -> None:
    def fail(request: DecideRequest) -> DecideAnswer:
        raise ValueError("oops")

    ego, _ = meeting(fail)
    assert outcome(ego.until_answered()) == "failed"


def moving_on(ego: Ego, gateway: Gateway, go: threading.Event, **now: object) -> Decision:
    """The scene changes while the question is under way; the decision that its answer brings."""
    ego.until(lambda d: report(d).question == 1)
    gateway.requests.next()
    ego.scene = floor(*now.pop("others", (A, B)), **now)  # type: ignore[misc,arg-type]
    ego.cycle()
    go.set()
    return ego.until_answered()


@pytest.fixture
def pausing(meeting: Meet) -> Callable[..., tuple[Ego, Gateway, threading.Event]]:
    """An ego and a gateway that gives its first answer only when it is told to."""

    def make(*helpers: str, **fields: object) -> tuple[Ego, Gateway, threading.Event]:
        go = threading.Event()

        def handle(request: DecideRequest) -> DecideAnswer:
            go.wait()
            return answer(request, *helpers, **fields)  # type: ignore[arg-type]

        ego, gateway = meeting(handle)
        return ego, gateway, go

    return make


Pausing = Callable[..., tuple[Ego, Gateway, threading.Event]]


def test_a_robot_that_left_meanwhile_is_dropped_from_the_advice(pausing: Pausing) -> None:
    ego, gateway, go = pausing("A", "B")
    found = moving_on(ego, gateway, go, others=(A,))
    assert (outcome(found), found.source, found.participants) == ("adopted", "llm", ("E", "A"))
    assert report(found).answer.repaired == ("unknown_robot",)  # type: ignore[union-attr]
    assert found.repairs[0] == "dropped 'B': no such robot is known"


def test_advice_of_robots_that_all_left_is_refused(pausing: Pausing) -> None:
    ego, gateway, go = pausing("B")
    found = moving_on(ego, gateway, go, others=(A,))
    assert (outcome(found), found.source) == ("unknown_robot", "fallback")


def test_advice_for_a_link_that_has_shrunk_is_repaired(pausing: Pausing) -> None:
    ego, gateway, go = pausing("A", "B")
    found = moving_on(ego, gateway, go, capacity_bps=0.3e6)
    assert (outcome(found), found.algorithm) == ("adopted", "late")
    assert "infeasible" in report(found).answer.repaired  # type: ignore[union-attr]


def test_more_robots_than_the_link_carries_are_too_many(pausing: Pausing) -> None:
    big = {"early": 12_000}
    pair = [candidate(r, range(s, s + 20), sizes=big) for r, s in (("A", 20), ("B", 40))]
    ego, gateway, go = pausing("A", "B")
    found = moving_on(ego, gateway, go, others=pair, capacity_bps=1.5e6)
    assert (outcome(found), len(found.participants)) == ("adopted", 2)
    assert report(found).answer.repaired == ("too_many",)  # type: ignore[union-attr]


def test_advice_that_nobody_can_follow_any_more_is_infeasible(pausing: Pausing) -> None:
    ego, gateway, go = pausing("A", "B")
    found = moving_on(ego, gateway, go, capacity_bps=10_000)
    assert (outcome(found), found.source) == ("infeasible", "fallback")


def test_a_question_that_the_scene_has_left_is_followed_by_the_next_one(pausing: Pausing) -> None:
    ego, gateway, go = pausing("A")
    found = moving_on(ego, gateway, go, others=(A,))
    assert adopted(found)
    assert report(found).question == 2
    ego.until(lambda d: adopted(d) and report(d).answer.question == 2)  # type: ignore[union-attr]
    assert gateway.requests.next().request == 2
    ego.cycle()
    assert gateway.requests.empty()


@pytest.mark.parametrize("moved", [{"capacity_bps": 2e6}, {"others": (A,)}])
def test_a_change_of_link_or_scene_is_asked_about_at_once(
    meeting: Meet, moved: dict[str, object]
) -> None:
    ego, gateway = meeting(saying("A", "B"))
    ego.until(adopted)
    before = gateway.requests.next()
    ego.scene = floor(*moved.pop("others", (A, B)), **moved)  # type: ignore[misc,arg-type]
    assert report(ego.cycle()).question == 2
    assert gateway.requests.next().fingerprint != before.fingerprint


def of_question(decision: Decision, number: int) -> bool:
    answer = report(decision).answer
    return answer is not None and answer.question == number


def test_without_any_change_it_asks_again_after_the_period(meeting: Meet) -> None:
    ego, gateway = meeting(saying("A", "B"), llm_period_s=0.1)
    for number in (1, 2, 3):
        ego.until(lambda d, n=number: adopted(d) and of_question(d, n))  # type: ignore[misc]
    numbers = [gateway.requests.next().request for _ in range(3)]
    assert numbers == [1, 2, 3]


def test_advice_is_given_up_when_one_of_its_robots_leaves(meeting: Meet) -> None:
    ego, gateway = meeting(saying("A", "B"))
    ego.until(adopted)
    gateway.handler = saying()
    ego.scene = floor(A)
    given_up = ego.cycle()
    assert (given_up.source, given_up.participants) == ("fallback", ("E", "A"))
    assert report(given_up).ended == "unknown_robot"
    assert given_up.repairs[0].startswith("given up: dropped 'B'")


def test_advice_is_given_up_when_the_fallback_becomes_better(meeting: Meet) -> None:
    ego, gateway = meeting(saying("A"))
    ego.scene = floor(A)
    ego.until(adopted)
    gateway.handler = saying()
    ego.scene = floor(A, B)
    given_up = ego.cycle()
    assert (given_up.source, given_up.participants) == ("fallback", ("E", "A", "B"))
    assert report(given_up).ended == "worse"


def test_advice_is_given_up_when_it_does_not_fit_the_link_any_more(meeting: Meet) -> None:
    ego, gateway = meeting(saying("A", "B"))
    ego.until(adopted)
    gateway.handler = saying()
    ego.scene = floor(capacity_bps=0.3e6)
    given_up = ego.cycle()
    assert (given_up.source, given_up.algorithm) == ("fallback", "late")
    assert report(given_up).ended in ("worse", "infeasible")


def test_advice_does_not_last_for_ever(meeting: Meet) -> None:
    ego, _ = meeting(saying("A", "B"), llm_hold_max_s=0.2)
    ego.until(adopted)
    given_up = ego.until(lambda d: d.source == "fallback")
    assert report(given_up).ended == "too_old"
    assert given_up.repairs == ("given up: it is older than 0.2 s",)


def test_newer_advice_replaces_what_was_held(meeting: Meet) -> None:
    ego, _ = meeting(saying("A", "B"), llm_period_s=0.1)
    ego.until(adopted)
    assert report(ego.until(adopted)).ended == "replaced"


def test_a_killed_gateway_means_the_fallback_and_a_new_one_is_asked_at_once(
    shared_router: RouterProcess, open_session: SessionMaker, meeting: Meet
) -> None:
    ego, gateway = meeting(saying("A", "B"))
    ego.until(adopted)
    gateway.kill()
    gone = ego.until(lambda d: not report(d).gateway)
    assert (gone.source, report(gone).state, report(gone).ended) == (
        "fallback",
        "none",
        "no_gateway",
    )
    assert gone.repairs == ("no language model was asked: no LLM gateway is connected",)
    Gateway(open_session(shared_router.address), saying("A", "B"))
    back = ego.until(lambda d: d.source != "fallback")
    assert back.source == "llm"
    assert adopted(back)


def test_a_question_under_way_is_lost_with_its_gateway(pausing: Pausing) -> None:
    ego, gateway, go = pausing("A", "B")
    ego.until(lambda d: report(d).question == 1)
    gateway.requests.next()
    gateway.kill()
    lost = ego.until_answered()
    go.set()
    assert (outcome(lost), lost.source) == ("no_gateway", "fallback")


def test_a_lost_router_is_a_lost_gateway(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    ego, _ = meet(open_session, own_router.address, saying("A", "B"))
    ego.until(adopted)
    own_router.stop(kill=True)
    gone = ego.until(lambda d: not report(d).gateway)
    assert (gone.source, report(gone).ended) == ("fallback", "no_gateway")
    own_router.start()
    assert ego.until(lambda d: d.source != "fallback").source == "llm"


def test_hostile_text_reaches_nobody(meeting: Meet) -> None:
    nasty = "fine\x1b[2J\x1b]0;pwned\x07\r\n{}\u202e\ud800 " + "x" * 10_000
    ego, _ = meeting(saying("A", "B", reason=nasty, model="tiny\x1b[31m\nroot"))
    found = ego.until(adopted)
    assert found.reason.isprintable()
    assert len(found.reason) <= 500
    assert found.reason.startswith("The ego and 2 of 2 robots")
    assert found.model == "tiny [31m root"


@pytest.mark.parametrize("names", [["ghost"], ["../A"], ["A", "A", "ghost"], ["A\n", "*"]])
def test_invented_robots_take_no_part(meeting: Meet, names: list[str]) -> None:
    ego, _ = meeting(saying(*names))
    found = ego.until_answered()
    assert set(found.participants) <= {"E", "A", "B"}
    assert outcome(found) != "adopted"


def test_without_a_session_the_policy_falls_back_and_says_so() -> None:
    decision = Ego(None).cycle()
    assert (decision.source, decision.participants) == ("fallback", ("E", "A", "B"))
    assert decision.repairs == ("no language model was asked: no LLM gateway is connected",)
    assert report(decision).state == "none"


def test_an_ego_whose_own_state_is_not_known_goes_on_alone(meeting: Meet) -> None:
    ego, _ = meeting(saying("A", "B"))
    ego.scene = scene(candidate("E"), excluded={"E": "no beacon"})
    for _ in range(20):
        decision = ego.cycle()
        assert (decision.participants, decision.valid) == (("E",), False)
