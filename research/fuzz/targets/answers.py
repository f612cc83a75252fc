"""Targets: what language models and their clients say, and requests for Quality on Demand."""

from __future__ import annotations

from contextlib import suppress

import msgspec

from ego_agent.plan.prompting.answer import read_answer
from ego_agent.plan.prompting.prompt import LlmPrompt
from llm_gateway.answers import AnswerError, extract
from llm_gateway.backends.openai_wire import read_models, read_reply
from llm_gateway.http_chat import read_request
from llm_gateway.http_errors import HttpError
from llm_gateway.schemas import Schemas
from network_controller.qod.flows import overlap
from network_controller.qod.messages import CreateSession, read
from network_controller.qod.operations import OPERATIONS
from research.fuzz.target import Target
from swarm.errors import DecisionError, GatewayError

_PROMPT = LlmPrompt(
    messages=(), schema="{}", fingerprint="0" * 16, candidates=("R2", "R3"), ego="R1"
)
_SCHEMA = (
    '{"type":"object","required":["algorithm"],"properties":{"algorithm":{"enum":["early","late"]},'
    '"helpers":{"type":"array","items":{"type":"string"}}}}'
)
_SCHEMAS = Schemas()
_BODIES = tuple(dict.fromkeys(one.body for one in OPERATIONS if one.body is not None))


def _answer(data: bytes) -> None:
    """A model's words: JSON is looked for in them, and read as advice."""
    text = data.decode("utf-8", errors="replace")
    with suppress(AnswerError):
        text = extract(text, _SCHEMA, _SCHEMAS)
    advice = read_answer(text, _PROMPT)
    assert advice.participants[0] == _PROMPT.ego
    assert 0.0 <= advice.confidence <= 1.0


def _chat(data: bytes) -> None:
    """One byte for what it is: a client's request, a server's reply or its list of models."""
    if not data:
        return
    body = data[1:]
    match data[0] % 3:
        case 0:
            asked = read_request(body, {}, "127.0.0.1", "model")
            assert asked.job.prompt.max_tokens > 0
        case 1:
            read_reply(body, "a server")
        case 2:
            assert all(isinstance(name, str) for name in read_models(body, "a server"))


def _request(data: bytes) -> None:
    """One byte for the kind of body. What was read can be written and read again."""
    if not data:
        return
    kind = _BODIES[data[0] % len(_BODIES)]
    body = read(data[1:], kind)
    assert read(msgspec.json.encode(body), kind) == body
    if isinstance(body, CreateSession):
        assert overlap(body, body)


ANSWERS = Target(_answer, (DecisionError,), json_from=0)
CHAT = Target(_chat, (GatewayError, HttpError), json_from=1)
QOD = Target(_request, (msgspec.DecodeError,), json_from=1)
