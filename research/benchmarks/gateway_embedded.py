"""The embedded model through its back end: together or one by one, first or second request."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any

import jsonschema

from ego_agent.knowledge.base import Knowledge
from ego_agent.plan.prompting.prompt import make_prompt
from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.model import Prompt, Reply
from research.benchmarks.factory_scenes import factory_scene
from swarm.errors import DecisionError
from swarm.log import make_logger
from swarm.messages import ChatMessage
from worlds.registry import open_world

TOGETHER = 16
CONTEXT = 2048
MAX_TOKENS = 128
WAIT_S = 600.0
RATES_BPS = (5e6, 20e6, 55e6)
STEP = 10
"""Frames between two scenes: a second."""


async def embedded(model: Path, repeats: int) -> tuple[dict[str, float], dict[str, Any]]:
    """Figures and samples: batch_speedup, prefix_ratio, valid_constrained."""
    # Made before anything is timed.
    prompts = iter(list(islice(real_prompts(), repeats * (2 + 2 * TOGETHER))))
    backend = LlamaCpp(model, TOGETHER, CONTEXT, 0, make_logger("bench", level="error"))
    await backend.start()
    answers: list[tuple[Prompt, Reply]] = []

    async def ask(prompt: Prompt) -> float:
        begun = time.perf_counter()
        answers.append((prompt, await backend.complete(prompt, WAIT_S)))
        return time.perf_counter() - begun

    try:
        await ask(Prompt((ChatMessage("user", "Hello."),), '{"type":"boolean"}', 8))
        answers.clear()
        firsts, seconds = [], []
        for number in range(repeats):
            # As if nothing like it had been read before.
            cold = unlike(next(prompts), number)
            firsts.append(await ask(cold))
            seconds.append(await ask(unlike(next(prompts), number)))
        alone_s, together_s = [], []
        for _ in range(repeats):
            begun = time.perf_counter()
            for prompt in islice(prompts, TOGETHER):
                await ask(prompt)
            alone_s.append(time.perf_counter() - begun)
            begun = time.perf_counter()
            await asyncio.gather(*map(ask, islice(prompts, TOGETHER)))
            together_s.append(time.perf_counter() - begun)
    finally:
        await backend.close()
    figures = {
        "batch_speedup": round(median(alone_s) / median(together_s), 3),
        "prefix_ratio": round(median(seconds) / median(firsts), 3),
        "valid_constrained": sum(follows(*answer) for answer in answers) / len(answers),
    }
    samples = {
        "alone_s": alone_s,
        "together_s": together_s,
        "first_s": firsts,
        "second_s": seconds,
        "answers": len(answers),
        "prompt_tokens": [reply.tokens.prompt for _, reply in answers],
    }
    return figures, samples


def real_prompts() -> Iterator[Prompt]:
    """Questions of egos on the simulated floor, no two alike, an ego's second right after its
    first."""
    world = open_world("factory", robots=6, cache=Path("build/scans"))
    knowledge = Knowledge()
    frame = 0
    while True:
        frame += 2 * STEP
        for number, ego in enumerate(world.robots):
            for at in (frame, frame + STEP):
                rate_bps = RATES_BPS[(number + frame // STEP) % len(RATES_BPS)]
                scene = factory_scene(world, at, ego, knowledge, rate_bps)
                try:
                    asked = make_prompt(scene, knowledge, None, None)
                except DecisionError:
                    continue
                yield Prompt(asked.messages, asked.schema, MAX_TOKENS)


def unlike(prompt: Prompt, number: int) -> Prompt:
    """The same question with another beginning."""
    first, *others = prompt.messages
    changed = ChatMessage(first.role, f"Site {number}. {first.content}")
    return replace(prompt, messages=(changed, *others))


def follows(prompt: Prompt, reply: Reply) -> bool:
    """Whether the very words are JSON that follows the schema."""
    try:
        jsonschema.validate(json.loads(reply.text), json.loads(prompt.schema))
    except (ValueError, jsonschema.ValidationError):
        return False
    return True
