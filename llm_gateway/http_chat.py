"""OpenAI's chat completions: a request becomes a job, a completion becomes an answer."""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

from llm_gateway.http_errors import HttpError
from llm_gateway.model import Completion, Job, Prompt
from swarm.messages import ChatMessage
from swarm.messages.llm import MAX_PROMPT_CHARS

DEFAULT_DEADLINE_S = 60.0
DEFAULT_TOKENS = 256
MAX_SCHEMA_CHARS = 50_000
ANY_OBJECT = '{"type":"object"}'
_Seconds = Annotated[float, msgspec.Meta(ge=0.05, le=600)]
_Tokens = Annotated[int, msgspec.Meta(ge=1, le=4096)]


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


class _Chat(msgspec.Struct):
    """What the endpoint reads of a request; other fields change nothing and are let through."""

    messages: Annotated[list[_Turn], msgspec.Meta(min_length=1, max_length=64)]
    model: str | None = None
    response_format: _Format | None = None
    max_tokens: _Tokens | None = None
    max_completion_tokens: _Tokens | None = None
    stream: bool | None = None
    n: int | None = None
    tools: list[Any] | None = None


def read_job(raw: bytes, headers: Mapping[str, str], address: str, model: str) -> Job:
    """The job that a request asks for; `address` is whose it is where no client is named.

    Raises HttpError.
    """
    # First, because the time that reading takes is part of the client's.
    now = time.monotonic()
    try:
        chat = msgspec.json.decode(raw, type=_Chat)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise HttpError(400, f"the body is no chat completion request: {error}") from error
    if chat.stream:
        raise HttpError(400, "stream must be false: answers are whole", param="stream")
    if chat.n not in (None, 1):
        raise HttpError(400, f"n = {chat.n} is not offered; it must be 1", param="n")
    if chat.tools:
        raise HttpError(400, "tools are not offered; leave them out", param="tools")
    if chat.model not in (None, "", "default", model):
        raise HttpError(
            404,
            f"the model {chat.model[:200]!r} is not here; {model!r} is, and 'default' names it",
            code="model_not_found",
            param="model",
        )
    messages = tuple(_message(turn) for turn in chat.messages)
    if sum(len(message.content) for message in messages) > MAX_PROMPT_CHARS:
        raise HttpError(
            413,
            f"the messages have more than {MAX_PROMPT_CHARS} characters",
            code="too_large",
            param="messages",
        )
    most = chat.max_completion_tokens or chat.max_tokens or DEFAULT_TOKENS
    return Job(
        Prompt(messages, _schema(chat.response_format), most),
        client=_header(headers, "X-CoAdapt-Client", r"[A-Za-z0-9_-]{1,32}") or address,
        deadline=now + _deadline_s(headers),
        fingerprint=_header(headers, "X-CoAdapt-Fingerprint", r"[0-9a-f]{16,64}"),
    )


def write_answer(completion: Completion) -> bytes:
    """OpenAI's answer, with where it comes from beside it."""
    tokens = completion.tokens
    answer = {
        "id": f"chatcmpl-{uuid.uuid4().hex}",
        "object": "chat.completion",
        "created": int(time.time()),
        "model": completion.model,
        "choices": [
            {
                "index": 0,
                "message": {"role": "assistant", "content": completion.text},
                "finish_reason": "stop",
            }
        ],
        "usage": {
            "prompt_tokens": tokens.prompt,
            "completion_tokens": tokens.output,
            "total_tokens": tokens.prompt + tokens.output,
            "prompt_tokens_details": {"cached_tokens": tokens.reused},
        },
        "coadapt": {
            "source": completion.source,
            "hit": completion.hit,
            "age_s": completion.age_s,
            "timings": completion.timings,
        },
    }
    return msgspec.json.encode(answer)


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
