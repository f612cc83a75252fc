"""What operators may change while a swarm runs: how an ego decides, which robots are on duty."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from swarm.messages.base import Count, Message, Ns, RobotId
from swarm.messages.choices import Operator, PolicyName, QMin
from swarm.messages.intent import Intent, Words
from swarm.messages.obeyed import MAX_INTENTS, Effect, IntentInForce, Places, Sentence

Duty = Literal["on", "off", "ask"]
IntentAct = Literal["", "try", "confirm", "confirm-nobody", "withdraw"]
"""Nothing; tell the effect; obey from now on; obey although it leaves nobody to ask; end."""


Reason = Annotated[str, msgspec.Meta(max_length=2_500)]
MAX_REASONS = 256


class EgoWish(msgspec.Struct, frozen=True, kw_only=True):
    """What an operator wants of an ego's decisions; one that names nothing only asks."""

    policy: PolicyName | None = None
    q_min: QMin | None = None


class EgoSteering(Message, frozen=True, kw_only=True):
    """An operator's request to an ego."""

    request: Count = 0
    operator: Operator = ""
    """Who asks; it stands in the ego's log."""
    wish: EgoWish
    act: IntentAct = ""
    """What to do with `intent`, or with the intent `number`."""
    intent: Intent | None = None
    said: Words = ""
    """The words that the intent was understood from."""
    places: Places = ()
    """At least those that the intent names."""
    number: Count = 0
    """Of an intent: to withdraw it, or to confirm it under the number that another ego gave it; 0:
    the ego's next."""
    why: bool = False
    """Also tell why the newest decision was made."""


class EgoSteered(Message, frozen=True, kw_only=True):
    """How an ego decides from its next cycle on. A refused request changes nothing."""

    request: Count
    ego: RobotId
    policy: PolicyName
    q_min: QMin
    policies: tuple[PolicyName, ...]
    """Those that it knows."""
    intents: Annotated[tuple[IntentInForce, ...], msgspec.Meta(max_length=MAX_INTENTS)] = ()
    """Which have not ended, oldest first."""
    effect: Effect | None = None
    """Of the intent that was asked about."""
    number: Count = 0
    """That it has been given."""
    says: Annotated[tuple[Sentence, ...], msgspec.Meta(max_length=512)] = ()
    """The intent that was asked about, read back, and its effect, a sentence each."""
    why: Annotated[tuple[Reason, ...], msgspec.Meta(max_length=MAX_REASONS)] = ()
    """Sentences about the newest decision, where they were asked for; none before the first."""


class RobotSteering(Message, frozen=True, kw_only=True):
    """An operator's request to a robot."""

    request: Count = 0
    operator: Operator = ""
    """Who asks; it stands in the robot's log, and in its replies."""
    duty: Duty


class RobotSteered(Message, frozen=True, kw_only=True):
    """Whether a robot is part of the swarm: off duty it is not alive for anybody, tells nothing and
    answers no request for observations, but its process runs."""

    request: Count
    robot: RobotId
    on_duty: bool
    operator: Operator = ""
    """Who changed it last; empty where nobody has."""
    since_ns: Ns = 0
    """When, on the robot's clock; 0 where nobody has."""
