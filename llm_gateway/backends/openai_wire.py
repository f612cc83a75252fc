"""What is said to an OpenAI-compatible server and how its words are read."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from llm_gateway.model import Finish, Prompt, PromptRefusedError, Reply
from swarm.errors import GatewayError
from swarm.messages import LlmTokens

Form = Literal["json_schema", "json_object", "text"]
FORMS: tuple[Form, ...] = ("json_schema", "json_object", "text")
"""How a server is told the schema, best first. `json_schema` is OpenAI's, and vLLM's, Ollama's and
llama.cpp's; `json_object` with a schema beside it is what llama-cpp-python's server reads;
`text` asks in words."""

_TOO_LONG = re.compile(
    r"context.{0,24}(length|window|size)|prompt is too long|too many (input |prompt )?tokens",
    re.IGNORECASE,
)
_ABOUT_FORM = re.compile(r"response_format|json_schema|json_object", re.IGNORECASE)
MAX_TOKENS = 1_000_000_000
AGAIN_S = 600.0


@dataclass(slots=True)
class Dialect:
    """What a server was found to understand."""

    form: Form = "json_schema"
    again_at: float = math.inf
    """`time.monotonic()` seconds when better forms are tried again: it may have been one client's
    strange schema that was refused, or the server is another by now."""
    schemas: bool = False
    """`json_schema` was understood: a refusal is about one request, not about the form."""
    max_tokens: str = "max_tokens"
    """OpenAI's newer models know only `max_completion_tokens`."""
    temperature: bool = True
    """Some models refuse any but their own."""
    stop: bool = True
    """Some models refuse stop sequences, which the gateway sees to by itself, too."""
    usage: bool = True
    """Older servers do not know how to tell tokens at a stream's end."""

    def forms(self, now: float) -> tuple[Form, ...]:
        """Those to try, in this order."""
        return FORMS if now >= self.again_at else FORMS[FORMS.index(self.form) :]

    def learn(self, form: Form, now: float) -> None:
        """Remembers the form that a schema was understood in."""
        self.schemas = self.schemas or form == "json_schema"
        if self.schemas:
            self.form, self.again_at = "json_schema", math.inf
        elif form != self.form or now >= self.again_at:
            self.form, self.again_at = form, now + AGAIN_S


class _Error(msgspec.Struct):
    message: Any = ""
    code: Any = None
    param: Any = None


class _Details(msgspec.Struct):
    cached_tokens: Any = 0


class Usage(msgspec.Struct):
    """What a server tells of tokens, whatever that is."""

    prompt_tokens: Any = 0
    completion_tokens: Any = 0
    prompt_tokens_details: _Details | None = None


class _Message(msgspec.Struct):
    content: str


class _Choice(msgspec.Struct):
    message: _Message
    finish_reason: Any = None


class _Completion(msgspec.Struct):
    choices: list[_Choice]
    usage: Usage | None = None


class _Model(msgspec.Struct):
    id: str


class _Models(msgspec.Struct):
    data: list[_Model]


def request_body(
    prompt: Prompt, model: str, form: Form, dialect: Dialect, *, stream: bool = False
) -> bytes:
    """A chat completion request as JSON. Raises GatewayError `failed` for a schema that is none."""
    messages = [{"role": m.role, "content": m.content} for m in prompt.messages]
    body: dict[str, Any] = {"model": model, "messages": messages, "stream": stream}
    if stream and dialect.usage:
        body["stream_options"] = {"include_usage": True}
    body[dialect.max_tokens] = prompt.max_tokens
    if dialect.temperature or prompt.temperature:
        body["temperature"] = prompt.temperature
    if prompt.top_p != 1:
        body["top_p"] = prompt.top_p
    if prompt.seed is not None:
        body["seed"] = prompt.seed
    if prompt.stop and dialect.stop:
        body["stop"] = prompt.stop
    if prompt.schema and form == "text":
        # At the very end: what stands before is the same the next time, and need not be read again.
        messages[-1]["content"] += (
            "\n\nAnswer with one JSON object and nothing else. It follows this JSON schema: "
            + prompt.schema
        )
    elif prompt.schema:
        body["response_format"] = _response_format(prompt.schema, form)
    return msgspec.json.encode(body)


def _response_format(text: str, form: Form) -> dict[str, Any]:
    try:
        schema = msgspec.json.decode(text, type=dict[str, Any])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise GatewayError("failed", f"the schema is no JSON object: {error}") from None
    if form == "json_schema":
        described = {"name": "answer", "strict": True, "schema": schema}
        return {"type": "json_schema", "json_schema": described}
    return {"type": "json_object", "schema": schema}


def read_reply(raw: bytes, where: str) -> Reply:
    """A server's answer. Raises GatewayError `failed` for one of another shape.

    A model that stopped at `max_tokens` is no error here: whether what it wrote is of use shows
    when it is held against the schema.
    """
    try:
        completion = msgspec.json.decode(raw, type=_Completion)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise GatewayError("failed", f"{where} answered no chat completion: {error}") from None
    if not completion.choices:
        raise GatewayError("failed", f"{where} answered a chat completion without choices")
    choice = completion.choices[0]
    finish: Finish = "length" if choice.finish_reason == "length" else "stop"
    return Reply(choice.message.content, tokens_of(completion.usage), finish)


def tokens_of(usage: Usage | None) -> LlmTokens:
    """A server's count of tokens; 0 for each that it does not tell."""
    usage = usage or Usage()
    details = usage.prompt_tokens_details or _Details()
    return LlmTokens(
        prompt=_count(usage.prompt_tokens),
        reused=_count(details.cached_tokens),
        output=_count(usage.completion_tokens),
    )


def read_models(raw: bytes, where: str) -> list[str]:
    """The names that a server lists. Raises GatewayError `failed`."""
    try:
        models = msgspec.json.decode(raw, type=_Models)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise GatewayError("failed", f"{where} lists no models: {error}") from None
    return [model.id for model in models.data]


def adapt(dialect: Dialect, used: Dialect, prompt: Prompt, status: int, raw: bytes) -> bool:
    """Whether a refusal names a field that can be left out or named otherwise; then it is.

    `used` is the dialect as the refused request was written in it: another request may have been
    refused for the same field meanwhile. A temperature or a seed that a client asks for cannot be
    left out: the refusal is the answer.
    """
    param = _error(raw).param
    if status not in (400, 422):
        return False
    if param == "max_tokens" and used.max_tokens == param:
        dialect.max_tokens = "max_completion_tokens"
        return True
    if param == "temperature" and used.temperature and not prompt.temperature:
        dialect.temperature = False
        return True
    if param == "stop" and used.stop:
        dialect.stop = False
        return True
    if str(param).startswith("stream_options") and used.usage:
        dialect.usage = False
        return True
    return False


def refuses_form(status: int, raw: bytes) -> bool:
    """Whether another form may help: llama-cpp-python's server says 500 for one it cannot read."""
    if status in (400, 422):
        return not _too_long(raw)
    return status >= 500 and _ABOUT_FORM.search(_text(raw)) is not None


def refusal(status: int, headers: Mapping[str, str], raw: bytes, where: str) -> GatewayError:
    """What a status other than 200 means."""
    if status in (401, 403):
        # The server's own words are left out: they may quote the key.
        return GatewayError("failed", f"{where} answered {status}: it does not accept the API key")
    said = _printable(_error(raw).message or _text(raw))
    if status == 413 or (status in (400, 422, 500) and _too_long(raw)):
        return GatewayError("too_large", f"{where} answered {status}: {said}")
    if status in (429, 503):
        later = headers.get("Retry-After", "")
        wait = f"; it says to come back in {later} s" if re.fullmatch(r"\d{1,6}", later) else ""
        return GatewayError("unavailable", f"{where} answered {status}: {said}{wait}")
    kind = PromptRefusedError if status in (400, 422) else GatewayError
    return kind("failed", f"{where} answered {status}: {said}")


def _too_long(raw: bytes) -> bool:
    error = _error(raw)
    if error.code == "context_length_exceeded":
        return True
    return _TOO_LONG.search(str(error.message or _text(raw))) is not None


def _error(raw: bytes) -> _Error:
    """OpenAI's error object, or an empty one; some servers put it at the top."""
    try:
        found = msgspec.json.decode(raw)
        inner = found.get("error") if isinstance(found, dict) else None
        return msgspec.convert(inner if isinstance(inner, dict) else found, _Error)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return _Error()


def _text(raw: bytes) -> str:
    return raw[:2000].decode(errors="replace")


def _printable(text: Any) -> str:
    """One short line."""
    line = "".join(c if c.isprintable() else " " for c in str(text))
    return " ".join(line.split())[:200] or "(nothing)"


def _count(value: Any) -> int:
    """Tokens that a server tells; 0 where it tells nonsense."""
    return value if isinstance(value, int) and 0 <= value <= MAX_TOKENS else 0
