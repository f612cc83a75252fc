"""What the tests of the embedded model ask it."""

from __future__ import annotations

import json

from llm_gateway.backends.llamacpp.engine import Engine
from llm_gateway.model import Prompt, Reply
from swarm.errors import GatewayError
from swarm.messages import ChatMessage

SEQUENCES, CONTEXT = 4, 512
RULES = "You choose robots that share what they see. Few bytes are good, missed objects are bad."
SCHEMA = json.dumps(
    {
        "type": "object",
        "properties": {
            "participants": {
                "type": "array",
                "items": {"enum": ["R1", "R2", "R3", "R4"]},
                "uniqueItems": True,
                "contains": {"const": "R2"},
                "minItems": 1,
                "maxItems": 3,
            },
            "algorithm": {"enum": ["early", "intermediate", "late"]},
            "confidence": {"type": "number", "minimum": 0, "maximum": 1},
            "reason": {"type": "string", "maxLength": 24},
        },
        "required": ["participants", "algorithm", "confidence", "reason"],
    }
)


def ask(text: str, *, schema: str = SCHEMA, max_tokens: int = 64) -> Prompt:
    """A prompt whose beginning is the same for all."""
    messages = (ChatMessage(role="system", content=RULES), ChatMessage(role="user", content=text))
    return Prompt(messages, schema, max_tokens)


def run(engine: Engine, *prompts: Prompt) -> list[Reply]:
    """Answers to prompts that are asked together. Raises the GatewayError of one that has none."""
    for i, prompt in enumerate(prompts):
        engine.submit(i, prompt)
    found: dict[int, Reply] = {}
    while engine.busy:
        for ident, outcome in engine.step():
            if isinstance(outcome, GatewayError):
                raise outcome
            found[ident] = outcome
    return [found[i] for i in range(len(prompts))]
