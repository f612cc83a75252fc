"""The bodies of requests and answers of the HTTP endpoint, named as OpenAI names them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from llm_gateway.model import Completion, Finish
from swarm.messages import LlmTimings

Tokens = Annotated[int, Meta(ge=1, le=4096)]
Stop = Annotated[str, Meta(min_length=1, max_length=1000)]
# What would change the answer and is not offered is read all the same, and refused by its name.
_Nothing = Annotated[
    list[Any] | None, Meta(description="Not offered.", extra_json_schema={"maxItems": 0})
]
_No = Annotated[
    bool | None, Meta(description="Not offered.", extra_json_schema={"enum": [False, None]})
]
_Zero = Annotated[
    float | None, Meta(description="Not offered.", extra_json_schema={"enum": [0, None]})
]


class Part(msgspec.Struct):
    """A piece of a turn's words."""

    type: Literal["text"]
    text: str


class Turn(msgspec.Struct):
    """What somebody has said."""

    role: Literal["system", "developer", "user", "assistant"]
    content: str | list[Part]


class AnswerSchema(msgspec.Struct):
    """The JSON schema of an answer."""

    schema: dict[str, Any]


class ResponseFormat(msgspec.Struct):
    """The form of the answer."""

    type: Literal["text", "json_object", "json_schema"]
    json_schema: AnswerSchema | None = None
    schema: dict[str, Any] | None = None
    """Beside `json_object`, as llama.cpp's servers read it."""


class StreamOptions(msgspec.Struct):
    """What a stream tells beside the words."""

    include_usage: bool | None = None


class ChatRequest(msgspec.Struct):
    """What the endpoint reads of a request; other fields change nothing and are let through."""

    messages: Annotated[list[Turn], Meta(min_length=1, max_length=64)]
    model: str | None = None
    response_format: ResponseFormat | None = None
    max_tokens: Tokens | None = None
    max_completion_tokens: Tokens | None = None
    stream: bool | None = None
    stream_options: StreamOptions | None = None
    stop: Stop | Annotated[list[Stop], Meta(max_length=4)] | None = None
    temperature: Annotated[float, Meta(ge=0, le=2)] | None = None
    top_p: Annotated[float, Meta(ge=0, le=1)] | None = None
    seed: Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)] | None = None
    n: Annotated[int | None, Meta(extra_json_schema={"enum": [1, None]})] = None
    tools: _Nothing = None
    functions: _Nothing = None
    logprobs: _No = None
    logit_bias: Annotated[
        dict[str, float] | None,
        Meta(description="Not offered.", extra_json_schema={"maxProperties": 0}),
    ] = None
    presence_penalty: _Zero = None
    frequency_penalty: _Zero = None


class CachedTokens(msgspec.Struct, frozen=True):
    """Of a prompt's tokens, those that the model had read before."""

    cached_tokens: int


class Usage(msgspec.Struct, frozen=True, kw_only=True):
    """The tokens of an answer; none where the cache had it."""

    prompt_tokens: int
    completion_tokens: int
    total_tokens: int
    prompt_tokens_details: CachedTokens

    @classmethod
    def of(cls, completion: Completion) -> Usage:
        """What an answer took."""
        tokens = completion.tokens
        return cls(
            prompt_tokens=tokens.prompt,
            completion_tokens=tokens.output,
            total_tokens=tokens.prompt + tokens.output,
            prompt_tokens_details=CachedTokens(tokens.reused),
        )


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """Where an answer comes from, and where its time went; OpenAI has no such thing."""

    source: Literal["llm", "cache"]
    hit: Literal["", "exact", "fingerprint"]
    age_s: float
    timings: LlmTimings

    @classmethod
    def of(cls, completion: Completion) -> Origin:
        """That of an answer."""
        return cls(
            source=completion.source,
            hit=completion.hit,
            age_s=completion.age_s,
            timings=completion.timings,
        )


class Said(msgspec.Struct, frozen=True):
    """The words of an answer."""

    role: Literal["assistant"]
    content: str


class Choice(msgspec.Struct, frozen=True):
    """The answer: there is one."""

    index: int
    message: Said
    finish_reason: Finish


class ChatCompletion(msgspec.Struct, frozen=True, kw_only=True):
    """OpenAI's answer, with where it comes from beside it."""

    id: str
    object: Literal["chat.completion"] = "chat.completion"
    created: int
    """Seconds since the epoch."""
    model: str
    choices: tuple[Choice, ...]
    usage: Usage
    coadapt: Origin


class Delta(msgspec.Struct, frozen=True, kw_only=True):
    """More words; the first chunk says whose they are."""

    role: Literal["assistant"] | UnsetType = UNSET
    content: str | UnsetType = UNSET


class ChunkChoice(msgspec.Struct, frozen=True):
    """What a chunk adds to the answer."""

    index: int
    delta: Delta
    finish_reason: Finish | None


class ChatChunk(msgspec.Struct, frozen=True, kw_only=True):
    """A piece of an answer. The last one of the words tells where they come from; where it was
    asked for, one without words follows that tells the tokens."""

    id: str
    object: Literal["chat.completion.chunk"] = "chat.completion.chunk"
    created: int
    model: str
    choices: tuple[ChunkChoice, ...]
    usage: Usage | UnsetType | None = UNSET
    coadapt: Origin | UnsetType = UNSET


class Model(msgspec.Struct, frozen=True, kw_only=True):
    """The model that answers."""

    id: str
    object: Literal["model"] = "model"
    created: int
    """When the gateway began, seconds since the epoch."""
    owned_by: Literal["coadapt"] = "coadapt"


class Models(msgspec.Struct, frozen=True, kw_only=True):
    """The list of models: there is one."""

    object: Literal["list"] = "list"
    data: tuple[Model, ...]


class ErrorDetail(msgspec.Struct, frozen=True, kw_only=True):
    """Why a request has no answer."""

    message: str
    type: str
    param: str | None
    """The field that is not as it must be."""
    code: str | None


class ErrorBody(msgspec.Struct, frozen=True):
    """The body of every refusal."""

    error: ErrorDetail
