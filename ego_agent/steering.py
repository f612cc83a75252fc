"""What operators may change while an ego runs: its policy and Q_min."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.plan.policies.base import Connecting, Policy, Preparing
from ego_agent.plan.policies.registry import make_policy, policy_names
from ego_agent.settings import EgoSettings
from swarm import keyspace
from swarm.log import Logger
from swarm.messages import Algorithm, EgoSteered, EgoSteering, EgoWish
from swarm.session import Session


class Steering:
    """The policy and Q_min of the next cycle. `take` belongs to the control cycle's thread; all
    else may be called from any."""

    def __init__(
        self, settings: EgoSettings, policy: Policy, algorithms: Sequence[Algorithm], log: Logger
    ) -> None:
        """`policy`: the one to begin with; `algorithms`: what is decided among. Raises
        DecisionError where the policy cannot decide here."""
        self._settings = settings
        self._algorithms = algorithms
        self._log = log
        self._lock = threading.Lock()
        """Of operators' wishes; the control cycle does not wait for it."""
        self._session: Session | None = None
        self._q_min = settings.q_min
        self._policy = self._prepared(policy)

    def attach(self, session: Session) -> None:
        """Takes operators' wishes from now on, and connects the policy."""
        with self._lock:
            self._session = session
            self._connect(self._policy)
        key = keyspace.ego_steering(session.swarm, self._settings.ego)
        session.serve(key, EgoSteering, self.steer, workers=1)

    def take(self, knowledge: Knowledge) -> Policy:
        """The policy of a cycle that begins now; Q_min is put into the knowledge."""
        q_min = self._q_min
        if knowledge.objective.q_min != q_min:
            knowledge.objective = msgspec.structs.replace(knowledge.objective, q_min=q_min)
        return self._policy

    def steer(self, request: EgoSteering) -> EgoSteered:
        """Carries out a wish whole or not at all. Raises DecisionError for a policy that is unknown
        or cannot decide here."""
        wish = request.wish
        with self._lock:
            if wish.policy is not None and wish.policy != self._policy.name:
                policy = self._prepared(make_policy(wish.policy, self._algorithms))
                self._connect(policy)
                before, self._policy = self._policy, policy
                _let_go(before)
            if wish.q_min is not None:
                self._q_min = wish.q_min
            if wish != EgoWish():
                self._log.info(
                    "steered",
                    policy=self._policy.name,
                    q_min=self._q_min,
                    operator=request.operator or "unknown",
                )
            return EgoSteered(
                request=request.request,
                ego=self._settings.ego,
                policy=self._policy.name,
                q_min=self._q_min,
                policies=policy_names(),
            )

    def close(self) -> None:
        """Lets go of the policy."""
        with self._lock:
            _let_go(self._policy)

    def _prepared(self, policy: Policy) -> Policy:
        if isinstance(policy, Preparing):
            policy.prepare(self._settings)
        return policy

    def _connect(self, policy: Policy) -> None:
        if self._session is not None and isinstance(policy, Connecting):
            policy.connect(self._session, self._settings)


def _let_go(policy: Policy) -> None:
    if isinstance(policy, Connecting):
        policy.close()
