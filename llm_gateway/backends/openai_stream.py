"""An OpenAI-compatible server's answer that comes as server-sent events."""

from __future__ import annotations

from typing import Any

import msgspec

from llm_gateway.backends.openai_wire import Usage, tokens_of
from llm_gateway.model import Finish, Reply
from swarm.errors import GatewayError

DONE = b"[DONE]"


class _Delta(msgspec.Struct):
    content: str | None = None


class _Choice(msgspec.Struct):
    delta: _Delta = msgspec.field(default_factory=_Delta)
    finish_reason: Any = None


class _Chunk(msgspec.Struct):
    choices: list[_Choice] = []
    usage: Usage | None = None
    error: Any = None


class StreamedReply:
    """Takes bytes as they come; `where` names the server in errors."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._rest = b""
        self._text = ""
        self._usage: Usage | None = None
        self._finish: Finish | None = None
        self._done = False

    def take(self, raw: bytes) -> str:
        """The words in some bytes. Raises GatewayError `failed` for what is no chunk."""
        *lines, self._rest = (self._rest + raw).split(b"\n")
        words = "".join(map(self._line, lines))
        self._text += words
        return words

    def reply(self) -> Reply:
        """The whole answer. Raises GatewayError `failed` where it broke off."""
        if self._finish is None and not self._done:
            raise GatewayError("failed", f"{self._where} broke its answer off")
        return Reply(self._text, tokens_of(self._usage), self._finish or "stop")

    def _line(self, line: bytes) -> str:
        if not line.startswith(b"data:"):
            return ""
        data = line[5:].strip()
        if data == DONE:
            self._done = True
            return ""
        try:
            chunk = msgspec.json.decode(data, type=_Chunk)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise GatewayError("failed", f"{self._where} streams no chunks: {error}") from None
        if chunk.error is not None:
            raise GatewayError("failed", f"{self._where} failed amid its answer")
        self._usage = chunk.usage or self._usage
        if not chunk.choices:
            return ""
        choice = chunk.choices[0]
        if choice.finish_reason is not None:
            self._finish = "length" if choice.finish_reason == "length" else "stop"
        return choice.delta.content or ""
