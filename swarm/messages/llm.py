"""Between an ego and the LLM gateway: what is asked of a language model, and what came of it."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from swarm.messages.base import Count, Message, RobotId

MAX_PROMPT_CHARS = 200_000
"""Of all messages of one request together; larger ones are refused."""

NonNegative = Annotated[float, msgspec.Meta(ge=0)]


class ChatMessage(msgspec.Struct, frozen=True):
    """One turn of a chat."""

    role: Literal["system", "user", "assistant"]
    content: Annotated[str, msgspec.Meta(max_length=MAX_PROMPT_CHARS)]


class DecideRequest(Message, frozen=True, kw_only=True):
    """An ego's request for advice."""

    request: Count
    """The ego's own number of it."""
    ego: RobotId
    messages: Annotated[tuple[ChatMessage, ...], msgspec.Meta(min_length=1, max_length=16)]
    """The constant part first: models reuse what they have read of an equal beginning."""
    schema: Annotated[str, msgspec.Meta(max_length=50_000)]
    """JSON schema of the answer, as text: it holds the hard rules of this very scene."""
    fingerprint: Annotated[str, msgspec.Meta(pattern=r"^([0-9a-f]{16,64})?(?!\n)$")] = ""
    """Of the quantised scene: an answer for an equal one may be given. Empty: only for an equal
    prompt."""
    deadline_s: Annotated[float, msgspec.Meta(ge=0.05, le=600)]
    """How long the ego waits, from receipt; later it is dropped, not answered."""
    max_tokens: Annotated[int, msgspec.Meta(ge=1, le=4096)] = 256


class LlmTokens(msgspec.Struct, frozen=True, kw_only=True):
    """Tokens of one call of a model; 0 where the back end does not tell."""

    prompt: Count = 0
    reused: Count = 0
    """Of the prompt: not read again, because an earlier one began like it."""
    output: Count = 0


class LlmTimings(msgspec.Struct, frozen=True, kw_only=True):
    """Where the time went, milliseconds on the gateway's clock."""

    queue_ms: NonNegative = 0.0
    """Until a place at the model was free."""
    model_ms: NonNegative = 0.0
    total_ms: NonNegative = 0.0


class DecideAnswer(Message, frozen=True, kw_only=True):
    """A model's answer that follows the request's schema."""

    request: Count
    decision: Annotated[str, msgspec.Meta(max_length=MAX_PROMPT_CHARS)]
    """JSON text that is valid by the request's schema."""
    source: Literal["llm", "cache"]
    hit: Literal["", "exact", "fingerprint"] = ""
    """By what the cache knew it."""
    model: Annotated[str, msgspec.Meta(max_length=200)]
    age_s: NonNegative = 0.0
    """Since the model gave it; 0 when it was made for this request."""
    tokens: LlmTokens = LlmTokens()
    timings: LlmTimings = LlmTimings()


class GatewayState(Message, frozen=True, kw_only=True):
    """How the LLM gateway stands with its model."""

    model: Annotated[str, msgspec.Meta(max_length=200)]
    trouble: Annotated[str, msgspec.Meta(max_length=300)]
    """Why the model does not answer; empty where it does, or nobody knows."""
