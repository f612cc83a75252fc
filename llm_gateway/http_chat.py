"""OpenAI's chat completions: a request becomes a job, a completion becomes an answer."""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec

from llm_gateway.http_errors import HttpError
from llm_gateway.model import Completion, Job, Prompt
from swarm.messages import ChatMessage
from swarm.messages.llm import MAX_PROMPT_CHARS

DEFAULT_DEADLINE_S = 60.0
DEFAULT_TOKENS = 256
ROLE = "http"
"""One for all: they show one token, or come from this host. A client's name is its own word."""
MAX_SCHEMA_CHARS = 50_000
ANY_OBJECT = '{"type":"object"}'
_Seconds = Annotated[float, msgspec.Meta(ge=0.05, le=600)]
_Tokens = Annotated[int, msgspec.Meta(ge=1, le=4096)]
_Stop = Annotated[str, msgspec.Meta(min_length=1, max_length=1000)]


class _Part(msgspec.Struct):
    type: Literal["text"]
    text: str


class _Turn(msgspec.Struct):
    role: Literal["system", "developer", "user", "assistant"]
    content: str | list[_Part]


class _Schema(msgspec.Struct):
    schema: dict[str, Any]


class _Format(msgspec.Struct):
    type: Literal["text", "json_object", "json_schema"]
    json_schema: _Schema | None = None
    schema: dict[str, Any] | None = None
    """Beside `json_object`, as llama.cpp's servers read it."""


class _Options(msgspec.Struct):
    include_usage: bool | None = None


class _Chat(msgspec.Struct):
    """What the endpoint reads of a request; other fields change nothing and are let through."""

    messages: Annotated[list[_Turn], msgspec.Meta(min_length=1, max_length=64)]
    model: str | None = None
    response_format: _Format | None = None
    max_tokens: _Tokens | None = None
    max_completion_tokens: _Tokens | None = None
    stream: bool | None = None
    stream_options: _Options | None = None
    stop: _Stop | Annotated[list[_Stop], msgspec.Meta(max_length=4)] | None = None
    temperature: Annotated[float, msgspec.Meta(ge=0, le=2)] | None = None
    top_p: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None
    seed: Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)] | None = None
    n: int | None = None
    tools: list[Any] | None = None
    functions: list[Any] | None = None
    logprobs: bool | None = None
    logit_bias: dict[str, float] | None = None
    presence_penalty: float | None = None
    frequency_penalty: float | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """A request, read."""

    job: Job
    stream: bool
    include_usage: bool
    """A stream's last chunk tells the tokens."""


def read_request(raw: bytes, headers: Mapping[str, str], address: str, model: str) -> Asked:
    """What a request asks for; `address` is whose it is where no client is named.

    Raises HttpError.
    """
    # First, because the time that reading takes is part of the client's.
    now = time.monotonic()
    try:
        chat = msgspec.json.decode(raw, type=_Chat)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        at = re.search(r"`\$\.(\w+)", str(error))
        raise HttpError(
            400,
            f"the body is no chat completion request: {error}",
            param=at.group(1) if at else None,
        ) from error
    _refuse_unoffered(chat)
    if chat.model not in (None, "", "default", model):
        raise unknown_model(chat.model, model)
    messages = tuple(_message(turn) for turn in chat.messages)
    if sum(len(message.content) for message in messages) > MAX_PROMPT_CHARS:
        raise HttpError(
            413,
            f"the messages have more than {MAX_PROMPT_CHARS} characters",
            code="too_large",
            param="messages",
        )
    prompt = Prompt(
        messages,
        _schema(chat.response_format),
        chat.max_completion_tokens or chat.max_tokens or DEFAULT_TOKENS,
        stop=(chat.stop,) if isinstance(chat.stop, str) else tuple(chat.stop or ()),
        temperature=chat.temperature or 0.0,
        top_p=1.0 if chat.top_p is None else chat.top_p,
        seed=chat.seed,
    )
    job = Job(
        prompt,
        client=_header(headers, "X-CoAdapt-Client", r"[A-Za-z0-9_-]{1,32}") or address,
        deadline=now + _deadline_s(headers),
        fingerprint=_header(headers, "X-CoAdapt-Fingerprint", r"[0-9a-f]{16,64}"),
        role=ROLE,
    )
    usage = chat.stream_options is not None and bool(chat.stream_options.include_usage)
    return Asked(job, bool(chat.stream), usage)


def unknown_model(name: str, model: str) -> HttpError:
    """The answer to a request that names another model than ours."""
    return HttpError(
        404,
        f"the model {name[:200]!r} is not here; {model!r} is, and 'default' names it",
        code="model_not_found",
        param="model",
    )


def write_answer(completion: Completion) -> bytes:
    """OpenAI's answer, with where it comes from beside it."""
    answer = {
        "id": f"chatcmpl-{uuid.uuid4().hex}",
        "object": "chat.completion",
        "created": int(time.time()),
        "model": completion.model,
        "choices": [
            {
                "index": 0,
                "message": {"role": "assistant", "content": completion.text},
                "finish_reason": completion.finish,
            }
        ],
        "usage": usage_of(completion),
        "coadapt": origin_of(completion),
    }
    return msgspec.json.encode(answer)


def usage_of(completion: Completion) -> dict[str, Any]:
    """The tokens of an answer, as OpenAI tells them; none where the cache had it."""
    tokens = completion.tokens
    return {
        "prompt_tokens": tokens.prompt,
        "completion_tokens": tokens.output,
        "total_tokens": tokens.prompt + tokens.output,
        "prompt_tokens_details": {"cached_tokens": tokens.reused},
    }


def origin_of(completion: Completion) -> dict[str, Any]:
    """Where an answer comes from, and where its time went."""
    return {
        "source": completion.source,
        "hit": completion.hit,
        "age_s": completion.age_s,
        "timings": completion.timings,
    }


def _refuse_unoffered(chat: _Chat) -> None:
    """What would change the answer, and is not offered. Raises HttpError."""
    for name in ("tools", "functions", "logprobs", "logit_bias"):
        if getattr(chat, name):
            raise HttpError(
                400,
                f"{name} is not offered; leave it out",
                code="unsupported_parameter",
                param=name,
            )
    for name, only in (("n", 1), ("presence_penalty", 0), ("frequency_penalty", 0)):
        if (value := getattr(chat, name)) not in (None, only):
            raise HttpError(
                400,
                f"{name} = {value} is not offered; it must be {only}",
                code="unsupported_value",
                param=name,
            )


def _message(turn: _Turn) -> ChatMessage:
    role = "system" if turn.role == "developer" else turn.role
    if isinstance(turn.content, str):
        return ChatMessage(role, turn.content)
    return ChatMessage(role, "".join(part.text for part in turn.content))


def _schema(asked: _Format | None) -> str:
    """The schema as text, its properties in the client's order: models write in that order."""
    if asked is None or asked.type == "text":
        return ""
    if asked.type == "json_object":
        found = asked.schema
    elif asked.json_schema is None:
        raise HttpError(400, "json_schema is missing", param="response_format.json_schema")
    else:
        found = asked.json_schema.schema
    if found is None:
        return ANY_OBJECT
    text = msgspec.json.encode(found).decode()
    if len(text) > MAX_SCHEMA_CHARS:
        raise HttpError(
            413,
            f"the schema has more than {MAX_SCHEMA_CHARS} characters",
            code="too_large",
            param="response_format",
        )
    return text


def _header(headers: Mapping[str, str], name: str, pattern: str) -> str:
    value = headers.get(name, "")
    if value and not re.fullmatch(pattern, value):
        raise HttpError(400, f"{name} = {value[:100]!r} is not valid; it must match {pattern}")
    return value


def _deadline_s(headers: Mapping[str, str]) -> float:
    value = headers.get("X-CoAdapt-Deadline", "")
    if not value:
        return DEFAULT_DEADLINE_S
    try:
        return msgspec.convert(float(value), _Seconds)
    except ValueError as error:
        raise HttpError(
            400,
            f"X-CoAdapt-Deadline = {value[:100]!r} is not valid; it must be 0.05 to 600 seconds",
        ) from error
