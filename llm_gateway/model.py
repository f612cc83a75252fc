"""What passes between the gateway's endpoints, its core and its back ends."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from swarm.messages import ChatMessage, LlmTimings, LlmTokens


@dataclass(frozen=True, slots=True)
class Prompt:
    """What a model is given. Equal prompts get equal answers: this is what the cache goes by."""

    messages: tuple[ChatMessage, ...]
    schema: str = ""
    """JSON schema of the answer, as text; empty: free text."""
    max_tokens: int = 256

    def key(self, model: str) -> str:
        """SHA-256 of the canonical prompt and the model, hexadecimal."""
        canonical = msgspec.json.encode(
            [model, [[m.role, m.content] for m in self.messages], self.schema, self.max_tokens]
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


@dataclass(frozen=True, slots=True)
class Reply:
    """What a back end returns for one prompt."""

    text: str
    tokens: LlmTokens = field(default_factory=LlmTokens)


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
