"""Probing: what has not come yet when nobody waits any more has not come."""

from __future__ import annotations

from ego_agent.knowledge.base import Knowledge
from ego_agent.plan.probe import FIRST_S, Prober
from ego_agent.plan.probe import _Sent as Sent
from swarm.messages import Probe


def waits_s(*, at_least: bool) -> float:
    """Until the next probe, after one whose answer took 0.25 s, or at least so long."""
    known, prober = Knowledge(), Prober()
    prober._sent = Sent(Probe(robot="R2", algorithm="late", bytes=100), 0.0, deadline_s=0.4)
    known.experience._clock = lambda: 1.0
    known.experience.record("R2", "late", 0.25, at_least=at_least)
    prober._hear(known, 1.0)
    assert prober._due_s is not None
    return prober._due_s - 1.0


def test_after_an_answer_the_next_robot_is_probed_at_once_and_after_silence_later() -> None:
    assert waits_s(at_least=False) == 0.0
    assert waits_s(at_least=True) == FIRST_S
