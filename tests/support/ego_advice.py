"""A gateway's end that says what a test wants, and an ego's control cycle without its other parts:
real sessions on a real router, real scenes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.llm import Llm
from ego_agent.settings import EgoSettings
from swarm import keyspace
from swarm.messages import AdviceReport, DecideAnswer, DecideRequest, Decision, LlmTokens
from swarm.session import Session
from tests.support.ego_scenes import NOW_NS, assert_valid, candidate, knowledge, scene, snapshot
from tests.support.zenoh_fixtures import WAIT_S, Inbox, SessionMaker, wait_until_served

A = candidate("A", range(20, 40), distance_m=10.0)
B = candidate("B", range(40, 60), distance_m=20.0)
Handler = Callable[[DecideRequest], DecideAnswer]


def floor(*others: Candidate, capacity_bps: float = 20e6) -> UnifiedScene:
    """The ego E sees a third of the floor, A and B the two others."""
    return scene(candidate("E", range(20)), *(others or (A, B)), capacity_bps=capacity_bps)


def answer(
    request: DecideRequest,
    *helpers: str,
    algorithm: str = "early",
    reason: str = "A and B see the rest",
    confidence: int = 90,
    **fields: Any,
) -> DecideAnswer:
    """What a gateway returns for a model's decision."""
    decision = {
        "algorithm": algorithm,
        "helpers": helpers,
        "confidence": confidence,
        "explanation": reason,
    }
    said = {"source": "llm", "model": "tiny", "tokens": LlmTokens(prompt=90, output=9)}
    return DecideAnswer(
        request=request.request, decision=json.dumps(decision), **{**said, **fields}
    )


def saying(*helpers: str, **fields: Any) -> Handler:
    """Always the same advice."""
    return lambda request: answer(request, *helpers, **fields)


class Gateway:
    """The gateway's end of a swarm: `handler` may be changed; `requests` holds what was asked."""

    def __init__(self, session: Session, handler: Handler) -> None:
        self.handler = handler
        self.requests: Inbox[DecideRequest] = Inbox()
        self.session = session
        session.serve(keyspace.llm_decide(session.swarm), DecideRequest, self._serve)
        session.declare_gateway()

    def _serve(self, request: DecideRequest) -> DecideAnswer:
        self.requests.put(request)
        return self.handler(request)

    def kill(self) -> None:
        """Its token and its queryable are gone, as when its process dies."""
        self.session.close()


class Ego:
    """Plan, cycle after cycle, with policy `llm`; every decision is checked."""

    def __init__(self, session: Session | None, **settings: Any) -> None:
        self.scene = floor()
        self.known: Knowledge = knowledge()
        self.policy = Llm()
        self.decision: Decision | None = None
        self.cycles = 0
        if session is not None:
            defaults: dict[str, Any] = {
                "llm_period_s": 600.0,
                "llm_deadline_s": WAIT_S,
                "llm_hold_max_s": 600.0,
            }
            self.policy.connect(session, EgoSettings(ego="E", **{**defaults, **settings}))

    def cycle(self) -> Decision:
        """One cycle; its decision is valid whatever the model says."""
        self.cycles += 1
        self.decision = plan(
            snapshot(), self.scene, self.policy, self.known, self.decision, self.cycles, NOW_NS
        )
        assert_valid(self.decision, self.scene, self.known)
        return self.decision

    def until(self, wanted: Callable[[Decision], bool]) -> Decision:
        """Cycles until a decision is wanted."""
        deadline = time.monotonic() + WAIT_S
        while not wanted(decision := self.cycle()):
            assert time.monotonic() < deadline, decision
            time.sleep(0.01)
        return decision

    def until_answered(self) -> Decision:
        """Cycles until a question has come to its end."""
        return self.until(lambda d: report(d).answer is not None)


def report(decision: Decision) -> AdviceReport:
    assert decision.advice is not None
    return decision.advice


def outcome(decision: Decision) -> str:
    found = report(decision).answer
    return found.outcome if found is not None else ""


def meet(
    open_session: SessionMaker, router: str, handler: Handler, **settings: float
) -> tuple[Ego, Gateway]:
    """An ego and a gateway that it can reach."""
    gateway = Gateway(open_session(router), handler)
    session = open_session(router)
    wait_until_served(session, keyspace.llm_decide(session.swarm))
    return Ego(session, **settings), gateway
