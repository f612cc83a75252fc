"""Whether a language model's choice follows the link: `reaction.json`.

Scenes of the simulated factory, each at 5, 20 and 55 Mbit/s, put to every installed model once
with the schema as a grammar and once with the schema in words, as servers without structured output
are told it. Points cost ten times what they do in the factory, 25 to 55 kB a frame as from real
LiDARs, at a tenth of the usual lambda: at the factory's own sizes and rates every choice fits
5 Mbit/s, and no model could show that it heeds the link (`link_matters_encoded` counts that).

`follows_link_ratio`: of the steps from one rate to the next at which `coverage` changes its choice,
those at which the model's own choice, before any repair, changes in the same way: to the same
algorithm from the same, or where `coverage` stays with its algorithm, to more or to fewer helpers.
Random choices that follow the schema are a row of their own: what they reach is the schema's doing.

`python -m research.benchmarks.reaction [--scenes N] [MODEL ...]`: names or paths of models.
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import json
import os
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.advice.judge import judge
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.validation import Unusable, validate
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting import LlmPrompt, make_prompt, read_answer
from ego_agent.settings import EgoSettings
from llm_gateway.answers import AnswerError, extract
from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import PACKAGES, find_model, installed_models
from llm_gateway.model import Prompt
from llm_gateway.schemas import Schemas
from research.benchmarks.factory_scenes import factory_scene
from research.benchmarks.intervals import share_interval
from research.benchmarks.report import write_report
from swarm.errors import DecisionError, GatewayError
from swarm.log import make_logger
from swarm.messages import ChatMessage
from worlds.factory.world import FactoryWorld

RATES_BPS = (5e6, 20e6, 55e6)
ROBOTS = (3, 4, 5, 6)
SCENES = 8
EGO = "R1"
PARALLEL, CONTEXT, TIMEOUT_S = 4, 1_536, 600.0
RESTART_S = 5.0
THREADS = int(os.environ.get("COADAPT_LLM_THREADS", "2"))
SIZES = 10
KNOWN = Knowledge(Objective(lambda_link=0.0, lambda_compute=0.0, lambda_cost=0.1))
IN_WORDS = "\n\nAnswer with one JSON object and nothing else. It follows this JSON schema: "


@dataclass(frozen=True)
class Case:
    """A scene at one rate."""

    scorer: Scorer
    prompt: LlmPrompt
    fallback: Score


@dataclass(frozen=True)
class Heard:
    """What came of one prompt: the model's own choice, and what is left of it."""

    text: str
    follows_schema: bool
    own: Score | None
    """None where it cannot be read, or names robots or algorithms that are not there."""
    decided: Score | None
    """After validation; None where it was refused."""
    repaired: bool
    adopted: bool


def scenes(number: int) -> Iterator[tuple[UnifiedScene, UnifiedScene]]:
    """Scenes with points of the size that real LiDARs have, and the same with the factory's."""
    for i in range(number):
        seed, robots = 1 + i // len(ROBOTS), ROBOTS[i % len(ROBOTS)]
        encoded = factory_scene(FactoryWorld(robots, seed), 97 * i, EGO, KNOWN, RATES_BPS[0])
        candidates = tuple(
            dataclasses.replace(c, sizes={**c.sizes, "early": SIZES * c.sizes["early"]})
            for c in encoded.candidates
        )
        yield dataclasses.replace(encoded, candidates=candidates), encoded


def cases(scene: UnifiedScene) -> list[Case]:
    """The scene at every rate; nothing was decided before."""
    found = []
    for rate_bps in RATES_BPS:
        at_rate = dataclasses.replace(scene, capacity_bps=rate_bps)
        scorer = Scorer(at_rate, KNOWN)
        wanted = Coverage().propose(at_rate, KNOWN, None)
        fallback = scorer.score(wanted.participants, _algorithm(wanted.algorithm))
        prompt = make_prompt(at_rate, KNOWN, None, None, scorer=scorer)
        found.append(Case(scorer, prompt, fallback))
    return found


def _algorithm(name: str) -> Any:
    return next(known for known in KNOWN.algorithms if known == name)


def choice(score: Score) -> tuple[Any, ...]:
    """What is decided; the ego's algorithm does not matter when it is alone."""
    return (frozenset(score.participants), score.algorithm if score.participants else "")


def judged(case: Case, text: str) -> Heard:
    """What the gateway and the ego would make of a model's words."""
    scorer = case.scorer
    try:
        answer = extract(text, case.prompt.schema, Schemas())
        follows = True
    except AnswerError:
        answer, follows = text, False
    try:
        advice = read_answer(answer, case.prompt)
    except DecisionError:
        return Heard(text, follows, None, None, False, False)
    own = None
    others = advice.participants[1:]
    if advice.algorithm in KNOWN.algorithms:
        algorithm = _algorithm(advice.algorithm)
        if all(scorer.known(robot, algorithm) for robot in others):
            own = scorer.score(others, algorithm)
    proposal = Proposal(advice.participants, advice.algorithm, advice.reason, "llm")
    found = validate(proposal, scorer.scene, KNOWN, policy="llm", cycle=0, now_ns=0)
    decided = None
    if not isinstance(found, Unusable):
        decided = scorer.score(found.participants, found.algorithm)
    margin = EgoSettings().llm_value_margin
    verdict = judge(advice.participants, advice.algorithm, scorer, case.fallback, margin=margin)
    return Heard(text, follows, own, decided, bool(found.repairs), verdict.refused is None)


def at_random(prompt: LlmPrompt, rng: random.Random) -> str:
    """An answer that follows the schema: an algorithm, then how many helpers, then who."""
    schema = json.loads(prompt.schema)
    options = schema.get("anyOf", [schema])
    by_name = {name: o["properties"] for o in options for name in _algorithms(o)}
    name = rng.choice(sorted(by_name))
    helpers = by_name[name]["helpers"]
    named: list[str] = []
    if "items" in helpers:
        number = rng.randint(helpers["minItems"], helpers["maxItems"])
        named = rng.sample(helpers["items"]["enum"], number)
    return json.dumps(
        {"algorithm": name, "helpers": named, "confidence": "medium", "explanation": ""}
    )


def _algorithms(option: dict[str, Any]) -> list[str]:
    return list(option["properties"]["algorithm"]["enum"])


async def ask(backend: LlamaCpp, prompts: Sequence[Prompt]) -> list[str]:
    """The words for each prompt; nothing where the model fails."""
    places = asyncio.Semaphore(PARALLEL)

    async def one(prompt: Prompt) -> str:
        async with places:
            for again in (True, True, False):
                try:
                    return (await backend.complete(prompt, TIMEOUT_S)).text
                except GatewayError as error:
                    print(f"reaction: {error}", file=sys.stderr)
                    if again and error.code == "unavailable":
                        await asyncio.sleep(RESTART_S)
        return ""

    return list(await asyncio.gather(*map(one, prompts)))


async def words(model: str, groups: Sequence[Sequence[Case]]) -> tuple[list[str], list[str]]:
    """A model's answers to all cases, with the grammar and without."""
    log = make_logger("bench", level="warning")
    backend = LlamaCpp(find_model(model), PARALLEL, CONTEXT, THREADS, log)
    await backend.start()
    try:
        flat = [case.prompt for group in groups for case in group]
        bound = [Prompt(p.messages, p.schema) for p in flat]
        free = [Prompt(_in_words(p), "", max_tokens=160) for p in flat]
        return await ask(backend, bound), await ask(backend, free)
    finally:
        await backend.close()


def _in_words(prompt: LlmPrompt) -> tuple[ChatMessage, ...]:
    *before, last = prompt.messages
    return (*before, ChatMessage(role=last.role, content=last.content + IN_WORDS + prompt.schema))


def steps(heard: Sequence[Heard], group: Sequence[Case]) -> Iterator[bool]:
    """Of each step of the rate at which `coverage` changes its choice: whether this one follows."""
    for (low, high), (case, after) in zip(pairwise(heard), pairwise(group), strict=True):
        if choice(case.fallback) != choice(after.fallback):
            yield _change(low.own, high.own) == _change(case.fallback, after.fallback)


def _change(low: Score | None, high: Score | None) -> tuple[Any, ...] | None:
    """How a choice changes with the rate."""
    if low is None or high is None:
        return None
    if low.algorithm != high.algorithm:
        return (low.algorithm, high.algorithm)
    return (np.sign(len(high.participants) - len(low.participants)),)


def ratio(found: Sequence[bool]) -> float | None:
    """The share of true ones; None of nothing."""
    return round(sum(found) / len(found), 4) if found else None


def row(
    model: str, groups: Sequence[Sequence[Case]], bound: Sequence[str], free: Sequence[str]
) -> dict[str, Any]:
    """The figures of one model."""
    flat = [case for group in groups for case in group]
    heard = list(map(judged, flat, bound))
    loose = list(map(judged, flat, free)) if free else []
    followed = _followed(heard, groups)
    return {
        "model": model,
        "scenes": len(groups),
        "unanswered": bound.count(""),
        "follows_link_ratio": ratio(followed),
        "follows_link_interval": share_interval(sum(followed), len(followed)),
        "follows_link_ratio_unconstrained": ratio(_followed(loose, groups)) if loose else None,
        "same_algorithm_ratio": ratio([_same_algorithm(part) for part in _parts(heard)]),
        "valid_ratio_constrained": ratio([h.follows_schema and bool(h.decided) for h in heard]),
        "valid_ratio_unconstrained": ratio([h.follows_schema and bool(h.decided) for h in loose]),
        "unrepaired_ratio_constrained": ratio([bool(h.decided) and not h.repaired for h in heard]),
        "equals_fallback_ratio": ratio(
            [
                h.decided is not None and choice(h.decided) == choice(case.fallback)
                for h, case in zip(heard, flat, strict=True)
            ]
        ),
        "adopted_ratio": ratio([h.adopted for h in heard]),
        "early_ratio": ratio([h.own is not None and h.own.algorithm == "early" for h in heard]),
    }


def _parts(heard: Sequence[Heard]) -> list[Sequence[Heard]]:
    return [heard[i : i + len(RATES_BPS)] for i in range(0, len(heard), len(RATES_BPS))]


def _followed(heard: Sequence[Heard], groups: Sequence[Sequence[Case]]) -> list[bool]:
    return [
        follows
        for part, group in zip(_parts(heard), groups, strict=True)
        for follows in steps(part, group)
    ]


def _same_algorithm(part: Sequence[Heard]) -> bool:
    """Whether a choice's algorithm is the same at all rates."""
    return len({h.own.algorithm if h.own else None for h in part}) == 1


def matters(group: Sequence[Case]) -> bool:
    """Whether `coverage` does not choose the same at all rates."""
    return len({choice(case.fallback) for case in group}) > 1


def main() -> int:
    """Measures and writes build/bench/reaction.json."""
    parser = argparse.ArgumentParser(prog="python -m research.benchmarks.reaction")
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("models", nargs="*", metavar="MODEL")
    args = parser.parse_args()
    models = args.models or installed_models()
    pairs = list(scenes(args.scenes))
    groups = [cases(plain) for plain, _ in pairs]
    flat = [case for group in groups for case in group]
    rng = random.Random(1)
    rows = [row("(random)", groups, [at_random(case.prompt, rng) for case in flat], [])]
    samples = {}
    for model in models:
        bound, free = asyncio.run(words(model, groups))
        name = find_model(model).stem if model not in PACKAGES else model
        rows.append(row(name, groups, bound, free))
        samples[name] = {"constrained": bound, "unconstrained": free}
    figures = {
        "rows": rows,
        "rates_bps": RATES_BPS,
        "link_matters": sum(map(matters, groups)),
        "link_matters_encoded": sum(matters(cases(encoded)) for _, encoded in pairs),
    }
    print(write_report("reaction", figures, samples))
    for entry in rows:
        print(entry)
    return 0


if __name__ == "__main__":
    sys.exit(main())
