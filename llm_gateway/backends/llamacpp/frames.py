"""What passes between the gateway and the model's process: MessagePack with its length before."""

from __future__ import annotations

from typing import BinaryIO

import msgspec

from llm_gateway.model import Finish, Prompt
from swarm.errors import GatewayCode
from swarm.messages import LlmTokens

MAX_BYTES = 8_000_000
_LENGTH = 4


class Request(msgspec.Struct, tag="ask", frozen=True):
    """A prompt to answer."""

    ident: int
    prompt: Prompt
    words: bool = False
    """Whether the answer is told while it comes, in `Words`."""


class Cancel(msgspec.Struct, tag="cancel", frozen=True):
    """Nobody waits for the answer any more. Acknowledged by `Gone`."""

    ident: int


class Ready(msgspec.Struct, tag="ready", frozen=True):
    """The model is loaded and has answered once."""

    features: str


class Broken(msgspec.Struct, tag="broken", frozen=True):
    """The model cannot be loaded; the process ends."""

    why: str


class Words(msgspec.Struct, tag="words", frozen=True):
    """What the model has said since the last ones."""

    ident: int
    text: str


class Answer(msgspec.Struct, tag="answer", frozen=True):
    """All that the model says."""

    ident: int
    text: str
    tokens: LlmTokens
    finish: Finish = "stop"
    likely: tuple[tuple[str, float], ...] = ()
    """See `Reply`."""


class Failed(msgspec.Struct, tag="failed", frozen=True):
    """A prompt got no answer."""

    ident: int
    code: GatewayCode
    why: str


class Gone(msgspec.Struct, tag="gone", frozen=True):
    """The work on a cancelled prompt has stopped, or had ended before."""

    ident: int


ToWorker = Request | Cancel
FromWorker = Ready | Broken | Words | Answer | Failed | Gone


def pack(frame: ToWorker | FromWorker) -> bytes:
    """A frame as it is written to a pipe."""
    body = msgspec.msgpack.encode(frame)
    return len(body).to_bytes(_LENGTH, "big") + body


def size(head: bytes) -> int:
    """Bytes of a frame's body. Raises ValueError for more than MAX_BYTES."""
    length = int.from_bytes(head, "big")
    if length > MAX_BYTES:
        raise ValueError(f"a frame of {length} bytes, at most {MAX_BYTES} are allowed")
    return length


def read(stream: BinaryIO) -> ToWorker | None:
    """The next frame for the worker; None at the end of the stream."""
    head = stream.read(_LENGTH)
    if len(head) < _LENGTH:
        return None
    length = size(head)
    body = stream.read(length)
    if len(body) < length:
        return None
    frame: ToWorker = _to_worker.decode(body)
    return frame


def from_worker(body: bytes) -> FromWorker:
    """A frame's body from the worker. Raises msgspec.DecodeError."""
    frame: FromWorker = _from_worker.decode(body)
    return frame


_to_worker = msgspec.msgpack.Decoder(ToWorker)
_from_worker = msgspec.msgpack.Decoder(FromWorker)
