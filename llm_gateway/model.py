"""What passes between the gateway's endpoints, its core and its back ends."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import msgspec

from swarm.errors import GatewayError
from swarm.messages import ChatMessage, LlmTimings, LlmTokens

Finish = Literal["stop", "length"]
"""Why an answer ended: the model or a stop sequence ended it, or it reached `max_tokens`."""
Hear = Callable[[str], None]
"""Hears an answer's words as they come, each once."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """What a model is given, and how it is to answer."""

    messages: tuple[ChatMessage, ...]
    schema: str = ""
    """JSON schema of the answer, as text; empty: free text."""
    max_tokens: int = 256
    stop: tuple[str, ...] = ()
    """The answer ends before the first of these."""
    temperature: float = 0.0
    """0 takes the likeliest words; above, chance has a part."""
    top_p: float = 1.0
    """Only the likeliest words that reach this probability together are drawn from."""
    seed: int | None = None
    """Of chance; None: another one each time."""
    certainty: bool = False
    """Whether the reply is to tell how likely the model found its words, where that is known."""

    @property
    def repeatable(self) -> bool:
        """Whether equal prompts get equal answers: only then may one serve the other."""
        return self.temperature == 0 or self.seed is not None

    @property
    def plain(self) -> bool:
        """Whether the answer is the model's likeliest and whole, as a scene's is."""
        return self.temperature == 0 and not self.stop

    @property
    def template(self) -> str:
        """SHA-256 of what the prompts of one kind have in common, which is what the system says."""
        fixed = [message.content for message in self.messages if message.role == "system"]
        return hashlib.sha256(msgspec.json.encode(fixed)).hexdigest()

    def key(self, model: str, role: str = "") -> str:
        """SHA-256 of the canonical prompt, the model and the role of who asks, hexadecimal; where
        chance has a part, a key of its own each time."""
        if not self.repeatable:
            return secrets.token_hex(32)
        canonical = msgspec.json.encode(
            [
                *(model, role, [[m.role, m.content] for m in self.messages], self.schema),
                *(self.max_tokens, self.stop, self.temperature, self.top_p, self.seed),
            ]
        )
        return hashlib.sha256(canonical).hexdigest()


@dataclass(frozen=True, slots=True)
class Job:
    """One request: a prompt, who asks, and until when."""

    prompt: Prompt
    client: str
    """Who asks: an ego's id, or an HTTP client's address. Nobody gets more than a fair share."""
    deadline: float
    """`time.monotonic()` seconds; nobody waits for the answer after it."""
    fingerprint: str = ""
    """Of the scene; empty: only an equal prompt's answer may be given from the cache."""
    role: str = ""
    """What who asks is, as its endpoint knows and not as it says: who has one role gets no answer
    that another role's question brought."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What a back end returns for one prompt."""

    text: str
    tokens: LlmTokens = field(default_factory=LlmTokens)
    finish: Finish = "stop"
    likely: tuple[tuple[str, float], ...] = ()
    """The text piece by piece, each with the probability that the model gave it; empty where nobody
    asked or knows."""


class PromptRefusedError(GatewayError):
    """The model is well, but takes no such prompt: to ask again would not help."""


@dataclass(frozen=True, slots=True)
class Completion:
    """What the gateway returns for one job: text that follows the prompt's schema."""

    text: str
    source: Literal["llm", "cache"]
    hit: Literal["", "exact", "fingerprint"]
    model: str
    age_s: float
    tokens: LlmTokens
    timings: LlmTimings
    finish: Finish = "stop"


class Completer(Protocol):
    """What the endpoint needs of the gateway."""

    @property
    def model(self) -> str:
        """The name of the model that answers."""
        ...

    async def complete(self, job: Job, hear: Hear | None = None) -> Completion:
        """Raises GatewayError; cancelling takes the job back."""
        ...
