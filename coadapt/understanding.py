"""What a wish in plain words means: the LLM gateway's answer, or why there is none."""

from __future__ import annotations

from datetime import datetime

from coadapt.asking import FIND_S
from coadapt.intent_flags import FLAGS
from swarm import keyspace
from swarm.errors import GatewayError, RefusedError, TransportError
from swarm.messages import Intent, Site, WishAnswer, WishRequest
from swarm.messages.wish import MAX_SAID_CHARS
from swarm.session import Session
from swarm.traffic import TrafficClass

DEADLINE_S = 10.0
"""A small model takes a third of a second; a busy machine several."""
OTHERWISE = f"wishes in force stay; `coadapt steer` takes the same as flags: {FLAGS}"


def understood(session: Session, wish: str, site: Site, now: datetime, operator: str) -> Intent:
    """What the swarm's gateway makes of a wish. Raises GatewayError, in one sentence, where none
    answers."""
    if len(wish) > MAX_SAID_CHARS:
        why = f"the wish has {len(wish)} characters; allowed: {MAX_SAID_CHARS}"
        raise GatewayError("too_large", f"{why}; {OTHERWISE}")
    request = WishRequest(
        operator=operator, wish=wish, site=site, now=now.isoformat(), deadline_s=DEADLINE_S
    )
    answer = session.ask(
        keyspace.llm_wish(session.swarm),
        request,
        WishAnswer,
        timeout_s=DEADLINE_S + FIND_S,
        traffic=TrafficClass.CONTROL,
    )
    try:
        return answer.result().message.understood
    except RefusedError as error:
        raise GatewayError("failed", f"{error.reason}; {OTHERWISE}") from error
    except TransportError as error:
        why = f"no language model answers in swarm {session.swarm!r} ({error})"
        raise GatewayError("unavailable", f"{why}; {OTHERWISE}") from error
