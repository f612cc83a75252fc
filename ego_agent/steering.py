"""What operators may change while an ego runs: its policy and Q_min, and intents that it obeys."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import CycleRecord
from ego_agent.knowledge.why import Follower, explain
from ego_agent.plan.intents.bind import bound_objective
from ego_agent.plan.intents.combine import Standing, standing
from ego_agent.plan.intents.given import Intents
from ego_agent.plan.policies.base import Connecting, Policy, Preparing
from ego_agent.plan.policies.registry import make_policy, policy_names
from ego_agent.replay import LastMinute
from ego_agent.settings import EgoSettings
from swarm import keyspace
from swarm.errors import DecisionError
from swarm.intent_words import effect_in_words, in_words
from swarm.log import Logger
from swarm.messages import Algorithm, Effect, EgoSteered, EgoSteering, EgoWish, IntentInForce
from swarm.messages.steer import MAX_REASONS
from swarm.process import Clock
from swarm.session import Session

NOBODY = "nobody"
"""The code of the refusal of an intent that leaves nobody to ask."""


class Steering:
    """How the next cycle decides. `take` belongs to the control cycle's thread; all else may be
    called from any."""

    def __init__(
        self,
        settings: EgoSettings,
        policy: Policy,
        knowledge: Knowledge,
        log: Logger,
        clock: Clock | None = None,
    ) -> None:
        """`policy`: the one to begin with; `knowledge`: with the objective of an ego that nobody
        steers. Raises DecisionError where the policy cannot decide here."""
        self._settings = settings
        self._knowledge = knowledge
        self._algorithms: Sequence[Algorithm] = knowledge.algorithms
        self._log = log
        self._clock = clock or Clock()
        self._lock = threading.Lock()
        """Of operators' wishes; the control cycle does not wait for it."""
        self._session: Session | None = None
        self._objective = knowledge.objective
        """Without intents."""
        self._policy = self._prepared(policy)
        self._wished: dict[str, Policy] = {}
        """Policies that intents name."""
        self.intents = Intents(settings.ego, _path(settings), log)
        for one in self.intents.all():
            self._wish_for(one)
        self.minute = LastMinute()
        self._told_lock = threading.Lock()
        self._told = Follower()
        """Of the journal's lines."""

    def attach(self, session: Session) -> None:
        """Takes operators' wishes from now on, and connects the policies."""
        with self._lock:
            self._session = session
            for policy in (self._policy, *self._wished.values()):
                self._connect(policy)
        key = keyspace.ego_steering(session.swarm, self._settings.ego)
        session.serve(key, EgoSteering, self.steer, workers=1)

    def take(self, knowledge: Knowledge) -> tuple[Policy, Standing]:
        """The policy of a cycle that begins now, and the intents that it obeys; the objective is
        put into the knowledge."""
        wishes = self.intents.standing(self._clock.now_ns())
        objective = bound_objective(self._objective, wishes)
        if knowledge.objective != objective:
            knowledge.objective = objective
        return self._by(wishes), wishes

    def note(self, line: CycleRecord) -> None:
        """A cycle's line, as soon as it is whole."""
        with self._told_lock:
            self._told.add(line)

    def _why(self) -> tuple[str, ...]:
        with self._told_lock:
            found = self._told.found
        if found is None:
            return ()
        return tuple(explain(found).text().split("\n")[:MAX_REASONS])

    def steer(self, request: EgoSteering) -> EgoSteered:
        """Carries out a wish whole or not at all. Raises DecisionError for a policy that is unknown
        or cannot decide here, and for an intent that cannot be obeyed."""
        wish = request.wish
        with self._lock:
            if wish.policy is not None and wish.policy != self._policy.name:
                policy = self._prepared(make_policy(wish.policy, self._algorithms))
                self._connect(policy)
                before, self._policy = self._policy, policy
                _let_go(before)
            if wish.q_min is not None:
                self._objective = msgspec.structs.replace(self._objective, q_min=wish.q_min)
            if wish != EgoWish():
                self._log.info(
                    "steered",
                    policy=self._policy.name,
                    q_min=self._objective.q_min,
                    operator=request.operator or "unknown",
                )
            effect, number = self._act(request)
            return EgoSteered(
                request=request.request,
                ego=self._settings.ego,
                policy=self._policy.name,
                q_min=self._objective.q_min,
                policies=policy_names(),
                intents=self.intents.all(),
                effect=effect,
                number=number,
                says=_said(request, effect),
                why=self._why() if request.why else (),
            )

    def close(self) -> None:
        """Lets go of the policies."""
        with self._lock:
            for policy in (self._policy, *self._wished.values()):
                _let_go(policy)

    def _act(self, request: EgoSteering) -> tuple[Effect | None, int]:
        """Does what is asked about an intent; its effect and number, where there are such."""
        if not request.act:
            return None, 0
        if request.act == "withdraw":
            self.intents.withdraw(request.number, request.operator)
            return None, request.number
        one = self.intents.made(request, self._clock.now_ns())
        effect = self._effect(one)
        if request.act == "try":
            return effect, 0
        if effect.nobody and request.act != "confirm-nobody":
            raise NobodyLeftError(
                "the wish leaves nobody to ask: the ego would go on alone; confirm that, too"
            )
        self._wish_for(one)
        self.intents.confirm(one)
        return effect, one.number

    def _effect(self, one: IntentInForce) -> Effect:
        """What an intent would have changed, as if it had been in force for the last minute."""
        now = self.intents.standing(self._clock.now_ns())
        then = standing([*(kept for kept in now.intents if kept.number != one.number), one])
        return self.minute.effect(
            self._knowledge,
            self._objective,
            (now, self._replayed(now)),
            (then, self._replayed(then)),
            time.monotonic(),
        )

    def _replayed(self, wishes: Standing) -> Policy:
        """A policy of its own for a replay; one that asks others is replaced by the fallback."""
        name = wishes.policy.value if wishes.policy else self._policy.name
        policy = make_policy(name, self._algorithms)
        if isinstance(policy, Connecting):
            policy = make_policy("coverage", self._algorithms)
        return self._prepared(policy)

    def _by(self, wishes: Standing) -> Policy:
        if wishes.policy is None:
            return self._policy
        return self._wished.get(wishes.policy.value, self._policy)

    def _wish_for(self, one: IntentInForce) -> None:
        """Gets the policy ready that an intent names. Raises DecisionError where that cannot be
        done."""
        name = one.intent.policy
        if name is not None and name not in self._wished:
            policy = self._prepared(make_policy(name, self._algorithms))
            self._connect(policy)
            self._wished[name] = policy

    def _prepared(self, policy: Policy) -> Policy:
        if isinstance(policy, Preparing):
            policy.prepare(self._settings)
        return policy

    def _connect(self, policy: Policy) -> None:
        if self._session is not None and isinstance(policy, Connecting):
            policy.connect(self._session, self._settings)


class NobodyLeftError(DecisionError):
    """An intent would leave nobody to ask, and that was not confirmed."""

    code = NOBODY


def _said(request: EgoSteering, effect: Effect | None) -> tuple[str, ...]:
    """The intent of a request in words, and its effect."""
    if request.intent is None or effect is None:
        return ()
    return (in_words(request.intent), *effect_in_words(effect))


def _path(settings: EgoSettings) -> Path | None:
    """Where the ego keeps its intents: beside its journal."""
    if not settings.journal:
        return None
    journal = Path(settings.journal)
    return journal.with_name(journal.name + ".intents")


def _let_go(policy: Policy) -> None:
    if isinstance(policy, Connecting):
        policy.close()
