"""OpenAI's chat completions: a request becomes a job, a completion becomes an answer."""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from llm_gateway.http_errors import HttpError
from llm_gateway.http_headers import CLIENT, FINGERPRINT, deadline_s, word
from llm_gateway.http_messages import (
    ChatCompletion,
    ChatRequest,
    Choice,
    Origin,
    ResponseFormat,
    Said,
    Turn,
    Usage,
)
from llm_gateway.model import Completion, Job, Prompt
from swarm.messages import ChatMessage
from swarm.messages.llm import MAX_PROMPT_CHARS

DEFAULT_TOKENS = 256
ROLE = "http"
"""One for all: they show one token, or come from this host. A client's name is its own word."""
MAX_SCHEMA_CHARS = 50_000
ANY_OBJECT = '{"type":"object"}'


@dataclass(frozen=True, slots=True)
class ParsedChat:
    """A request, read."""

    job: Job
    stream: bool
    include_usage: bool
    """A stream's last chunk tells the tokens."""


def read_request(raw: bytes, headers: Mapping[str, str], address: str, model: str) -> ParsedChat:
    """What a request asks for; `address` is whose it is where no client is named.

    Raises HttpError.
    """
    # First, because the time that reading takes is part of the client's.
    now = time.monotonic()
    try:
        chat = msgspec.json.decode(raw, type=ChatRequest)
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
        client=word(headers, CLIENT) or address,
        deadline=now + deadline_s(headers),
        fingerprint=word(headers, FINGERPRINT),
        role=ROLE,
    )
    usage = chat.stream_options is not None and bool(chat.stream_options.include_usage)
    return ParsedChat(job, bool(chat.stream), usage)


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
    said = Said("assistant", completion.text)
    answer = ChatCompletion(
        id=f"chatcmpl-{uuid.uuid4().hex}",
        created=int(time.time()),
        model=completion.model,
        choices=(Choice(0, said, completion.finish),),
        usage=Usage.of(completion),
        coadapt=Origin.of(completion),
    )
    return msgspec.json.encode(answer)


def _refuse_unoffered(chat: ChatRequest) -> None:
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


def _message(turn: Turn) -> ChatMessage:
    role = "system" if turn.role == "developer" else turn.role
    if isinstance(turn.content, str):
        return ChatMessage(role, turn.content)
    return ChatMessage(role, "".join(part.text for part in turn.content))


def _schema(asked: ResponseFormat | None) -> str:
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
