"""Single flight: equal requests share one call of the model."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from llm_gateway.model import Finish, Hear, Prompt
from swarm.errors import GatewayError
from swarm.messages import LlmTokens


@dataclass(frozen=True, slots=True)
class Landed:
    """What a call brought."""

    text: str
    tokens: LlmTokens
    finished: float
    """`time.monotonic()` seconds."""
    finish: Finish = "stop"


@dataclass(slots=True, eq=False)
class Flight:
    """One call of the model, waiting or under way, and how many wait for it."""

    prompt: Prompt
    key: str
    model: str
    fingerprint: str
    client: str
    """Who asked first: the call is counted as this client's."""
    role: str
    """Of all who wait."""
    deadline: float
    """`time.monotonic()` seconds: the latest of those who wait."""
    future: asyncio.Future[Landed]
    probe: bool = False
    """The circuit breaker waits for its outcome."""
    waiters: int = 0
    started: float | None = None
    """When the model was first asked, `time.monotonic()` seconds."""
    task: asyncio.Task[None] | None = None
    told: str = ""
    """The answer so far, where somebody listens."""
    listeners: list[Hear] = field(default_factory=list)

    def join(self, deadline: float, hear: Hear | None = None) -> None:
        """One more waits, and perhaps listens; the call may take as long as its most patient
        waiter."""
        self.waiters += 1
        self.deadline = max(self.deadline, deadline)
        if hear is not None:
            self.listeners.append(hear)
            if self.told:
                hear(self.told)

    def leave(self, hear: Hear | None) -> None:
        """One waits and listens no more."""
        self.waiters -= 1
        if hear is not None:
            self.listeners.remove(hear)

    def tell(self, words: str) -> None:
        """Gives more words of the answer to those who listen."""
        self.told += words
        for hear in self.listeners:
            hear(words)

    def land(self, landed: Landed) -> None:
        """Gives everybody the answer."""
        if not self.future.done():
            self.future.set_result(landed)

    def fail(self, error: GatewayError) -> None:
        """Gives everybody the reason why there is none."""
        if not self.future.done():
            self.future.set_exception(error)
            # Perhaps nobody waits any more, which is no fault to be logged.
            self.future.exception()
