"""The queue before the model: bounded, fair, earliest deadline first."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from llm_gateway.breaker import Breaker
from llm_gateway.budget import RetryBudget
from llm_gateway.waiting import Waiting

MOST, PER_CLIENT = 6, 3
CLIENTS = "ABCD"


@dataclass(eq=False)
class One:
    client: str
    deadline: float


def offer(queue: Waiting[One], one: One) -> tuple[bool, One | None]:
    """Puts a job where there is room; returns whether, and whom it displaced."""
    refusal, displaced = queue.refusal(one)
    if refusal:
        return False, None
    if displaced is not None:
        assert queue.remove(displaced)
    queue.put(one)
    return True, displaced


steps = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(CLIENTS), st.floats(0, 100)),
        st.just("pop"),
        st.integers(0, MOST - 1),
    ),
    max_size=60,
)


@given(steps)
def test_it_never_exceeds_its_bounds_and_loses_nothing(
    steps: list[tuple[str, float] | str | int],
) -> None:
    queue: Waiting[One] = Waiting(MOST, PER_CLIENT)
    inside: list[One] = []
    for step in steps:
        if isinstance(step, tuple):
            one = One(*step)
            crowd = sum(other.client == one.client for other in inside)
            taken, displaced = offer(queue, one)
            # Refused only where there is a reason.
            assert taken or crowd >= PER_CLIENT or len(inside) == MOST
            if displaced is not None:
                crowd_there = sum(other.client == displaced.client for other in inside)
                assert len(inside) == MOST
                assert (crowd_there, displaced.deadline) > (crowd + 1, one.deadline)
                inside.remove(displaced)
            if taken:
                inside.append(one)
        elif isinstance(step, int):
            if step < len(inside):
                assert queue.remove(inside.pop(step))
        elif inside:
            popped = queue.pop()
            own = [other for other in inside if other.client == popped.client]
            assert popped.deadline == min(other.deadline for other in own)
            inside.remove(popped)
        assert len(queue) == len(inside) <= MOST
        for client in CLIENTS:
            assert sum(other.client == client for other in inside) <= PER_CLIENT
    assert {id(one) for one in queue.clear()} == {id(one) for one in inside}


@given(st.lists(st.tuples(st.sampled_from("BCD"), st.floats(0, 1)), max_size=80))
def test_no_client_starves_however_urgent_the_others_are(others: list[tuple[str, float]]) -> None:
    queue: Waiting[One] = Waiting(100, 100)
    patient = One("A", 1e9)
    queue.put(patient)
    starts = dict.fromkeys("BCD", 0)
    for client, deadline in others:
        queue.put(One(client, deadline))
    while (popped := queue.pop()) is not patient:
        starts[popped.client] += 1
        # It comes back at once with something more urgent.
        queue.put(One(popped.client, -1.0))
    assert max(starts.values()) <= 2


@given(st.permutations(range(8)))
def test_between_clients_of_one_job_each_the_deadline_decides(deadlines: list[int]) -> None:
    queue: Waiting[One] = Waiting(100, 100)
    for deadline in deadlines:
        queue.put(One(f"client {deadline}", float(deadline)))
    assert [queue.pop().deadline for _ in deadlines] == sorted(deadlines)


def test_who_was_away_has_not_saved_up_turns() -> None:
    queue: Waiting[One] = Waiting(100, 100)
    for i in range(10):
        queue.put(One("A", float(i)))
        queue.pop()
    for i in range(3):
        queue.put(One("A", float(i)))
        queue.put(One("B", 100.0 + i))
    order = "".join(queue.pop().client for _ in range(6))
    assert "AA" not in order.rstrip("A")
    assert "BBB" not in order


def test_the_retry_budget_is_a_share_of_calls_and_a_trickle_of_time() -> None:
    budget = RetryBudget(0.0)
    assert budget.take(0.0)
    assert not budget.take(0.0)
    for _ in range(11):
        budget.called()
    assert budget.take(0.0)
    assert not budget.take(5.0)
    assert budget.take(11.0)
    # It can be saved up only so far.
    assert [budget.take(1e6) for _ in range(11)] == [True] * 10 + [False]


def test_the_breaker_counts_failures_in_a_row_only() -> None:
    breaker = Breaker(3, 10.0)
    for now in range(20):
        assert breaker.refusal(now) == ""
        assert not breaker.admit()
        if now % 3 == 2:
            breaker.succeeded()
        else:
            assert not breaker.failed(now, "down", probe=False)


def test_a_failed_probe_opens_the_breaker_for_another_while() -> None:
    breaker = Breaker(1, 10.0)
    assert breaker.failed(0.0, "down", probe=False)
    assert breaker.refusal(4.0) == "the breaker is open for another 6.0 s after: down"
    assert breaker.refusal(10.0) == ""
    assert breaker.admit()
    assert "one request" in breaker.refusal(10.0)
    # One that was on its way when the breaker opened decides nothing.
    assert not breaker.failed(11.0, "late", probe=False)
    assert breaker.failed(12.0, "still down", probe=True)
    assert breaker.refusal(21.9).endswith("after: still down")
    assert breaker.admit()
    breaker.abandoned()
    assert breaker.refusal(22.0) == ""
    assert breaker.admit()
    breaker.succeeded()
    assert (breaker.state, breaker.refusal(22.0)) == ("closed", "")
