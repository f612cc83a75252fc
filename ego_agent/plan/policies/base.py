"""The interface of a policy: it looks at one scene and says who should take part, and how."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.settings import EgoSettings
from swarm.messages import Algorithm, Decision
from swarm.session import Session


class Policy(Protocol):
    """A policy. It never has to be right: whatever it proposes is validated."""

    @property
    def name(self) -> str:
        """How the policy is called on the command line."""
        ...

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """Participants (with or without the ego) and an algorithm for this scene.

        `previous` is the decision in force. The call must return quickly; an exception makes this
        cycle's decision the fallback's.
        """
        ...


@runtime_checkable
class Requiring(Protocol):
    """A policy that makes no sense without a certain fusion algorithm."""

    @property
    def requires(self) -> Algorithm:
        """The algorithm that must be available."""
        ...


@runtime_checkable
class Preparing(Protocol):
    """A policy that needs more than its name to decide."""

    def prepare(self, settings: EgoSettings) -> None:
        """Called once, before the first cycle. Raises DecisionError where it could not decide."""
        ...


@runtime_checkable
class Connecting(Protocol):
    """A policy that asks others in the swarm. Without a session it must decide all the same."""

    def connect(self, session: Session, settings: EgoSettings) -> None:
        """Called once, when the router has been reached, on a thread beside the control cycle."""
        ...

    def close(self) -> None:
        """Asks no more. Called at the end, or when another policy takes over: then perhaps while
        it still proposes for the last time."""
        ...
