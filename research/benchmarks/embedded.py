"""The embedded model's speed with real prompts of 6 robots, and forms of the model side by side.

`cold`: nothing of the prompt was read before. `warm`: an ego's next question, a second later.
`bandwidth_only`: the same question with another link. Rows say what a form of the model costs, with
`--forms` also those that are not packaged: milliseconds of one decode (the least of several), and
how its words differ from the packaged form's: perplexity on this project's own documentation, and
the share of equal next tokens.

`python -m research.benchmarks.embedded [--repeats N] [--forms] [MODEL]`
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from ego_agent.knowledge.base import Knowledge
from ego_agent.plan.prompting import make_prompt
from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import DEFAULT_MODEL, find_model
from llm_gateway.backends.llamacpp.native import CHUNK, Native, Part
from llm_gateway.backends.llamacpp.requantise import convert
from llm_gateway.backends.llamacpp.slots import common
from llm_gateway.model import Prompt, Reply
from research.benchmarks.factory_scenes import factory_scene
from research.benchmarks.gateway_embedded import embedded as together_or_alone
from research.benchmarks.gateway_embedded import unlike
from research.benchmarks.report import write_report
from swarm.errors import DecisionError
from swarm.log import make_logger
from swarm.messages import ChatMessage
from worlds.registry import open_world

SEQUENCES, CONTEXT, MAX_TOKENS = 4, 2048, 128
WAIT_S = 600.0
LINK_BPS, OTHER_LINK_BPS = 5e6, 2.5e6
FORMS = ("Q8_0", "BF16", "F16", "Q4_0", "IQ4_NL")
FOLDER = Path("build/llm")
TOGETHER = ("batch_speedup", "prefix_ratio", "valid_constrained")
WORDS = Path("docs/architecture.md")


@dataclass(frozen=True)
class Case:
    """Three questions of one ego."""

    first: Prompt
    later: Prompt
    other_link: Prompt


def cases() -> Iterator[Case]:
    """Of egos on the simulated floor with 6 robots, from one to the next."""
    world = open_world("factory", robots=6, cache=Path("build/scans"))
    knowledge = Knowledge()

    def ask(frame: int, ego: str, rate_bps: float) -> Prompt:
        scene = factory_scene(world, frame, ego, knowledge, rate_bps)
        asked = make_prompt(scene, knowledge, None, None)
        return Prompt(asked.messages, asked.schema, MAX_TOKENS)

    frame = 0
    while True:
        for ego in world.robots:
            frame += 30
            try:
                yield Case(
                    ask(frame, ego, LINK_BPS),
                    ask(frame + 10, ego, LINK_BPS),
                    ask(frame + 10, ego, OTHER_LINK_BPS),
                )
            except DecisionError:
                continue


async def speed(model: Path, asked: list[Case]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures and samples of the back end as it is used."""
    backend = LlamaCpp(model, SEQUENCES, CONTEXT, 0, make_logger("bench", level="error"))
    await backend.start()
    samples: dict[str, list[float]] = {"cold_s": [], "warm_s": [], "bandwidth_only_s": []}
    tokens: list[dict[str, int]] = []

    async def timed(prompt: Prompt) -> tuple[float, Reply]:
        begun = time.perf_counter()
        reply = await backend.complete(prompt, WAIT_S)
        return time.perf_counter() - begun, reply

    try:
        for number, case in enumerate(asked):
            for name, prompt in zip(
                samples, (case.first, case.later, case.other_link), strict=True
            ):
                took, reply = await timed(unlike(prompt, number))
                samples[name].append(took)
                counts = reply.tokens
                tokens.append(
                    {"prompt": counts.prompt, "reused": counts.reused, "output": counts.output}
                )
        story = Prompt((ChatMessage(role="user", content="Tell a long story."),), "", 200)
        took, reply = await timed(story)
        read, read_reply = await timed(unlike(Prompt(asked[0].first.messages, "", 1), -1))
    finally:
        await backend.close()
    figures = {
        **{f"{name}_p50": round(median(values), 3) for name, values in samples.items()},
        "tokens_per_s": round(reply.tokens.output / took, 1),
        "read_tokens_per_s": round((read_reply.tokens.prompt) / read, 1),
        "output_tokens": round(median(one["output"] for one in tokens)),
    }
    return figures, {**samples, "tokens": tokens}


def sizes(native: Native, asked: list[Case]) -> dict[str, int]:
    """Tokens of a prompt, and those behind what egos' prompts begin with in common: the most."""
    prompts = [native.chat(case.first.messages) for case in asked]
    shared = min(common(prompts[0], other) for other in prompts[1:])
    return {
        "prompt_tokens_6": max(map(len, prompts)),
        "changing_tokens_6": max(len(prompt) - shared for prompt in prompts),
    }


def decode_ms(native: Native, tokens: list[int]) -> dict[str, float]:
    """Least time of one decode behind 512 tokens."""

    def least(parts: list[Part]) -> float:
        found = []
        for _ in range(5):
            begun = time.perf_counter()
            native.decode(parts)
            found.append(time.perf_counter() - begun)
            for number, at, _, _ in parts:
                native.keep(number, at)
        return round(1e3 * min(found), 1)

    first = least([(0, 0, tokens[:CHUNK], 1)])
    for at in (0, CHUNK):
        native.decode([(0, at, tokens[at : at + CHUNK], 1)])
    for number in range(1, 16):
        native.copy(0, number)
    one: list[Part] = [(number, 2 * CHUNK, tokens[:1], 1) for number in range(16)]
    return {"read_256_ms": first, "write_1_ms": least(one[:1]), "write_16_ms": least(one)}


def words(native: Native, tokens: list[int]) -> tuple[float, npt.NDArray[np.int64]]:
    """Perplexity of a text, and the likeliest next tokens in it."""
    native.keep(0, 0)
    loss, likeliest = 0.0, []
    for at in range(0, len(tokens) - 1, CHUNK):
        chunk = tokens[at : at + CHUNK]
        begin = native.decode([(0, at, chunk, len(chunk))])[0]
        for i, follows in enumerate(tokens[at + 1 : at + 1 + len(chunk)]):
            logits = native.logits(begin + i).astype(np.float64)
            top = logits.max()
            loss += float(top + np.log(np.exp(logits - top).sum()) - logits[follows])
            likeliest.append(int(logits.argmax()))
    return float(np.exp(loss / len(likeliest))), np.array(likeliest)


def forms(
    model: Path, asked: list[Case], others: Sequence[str]
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """A row for the packaged form of the model and for each of the others; sizes of the prompts."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    packaged = None
    found: dict[str, int] = {}
    for form in ("packaged", *others):
        path = model if form == "packaged" else FOLDER / f"{model.stem}-{form}.gguf"
        if not path.exists():
            convert(model, path, form)
        native = Native(path, sequences=16, context=1024, threads=os.cpu_count() or 1, chunk=CHUNK)
        text = native.tokens(WORDS.read_text(), special=False)[:769]
        costs = decode_ms(native, native.chat(asked[0].first.messages) + text)
        perplexity, likeliest = words(native, text)
        if packaged is None:
            packaged, found = likeliest, sizes(native, asked)
        same = float((likeliest == packaged).mean())
        row = {"form": form, "megabytes": round(path.stat().st_size / 1e6), **costs}
        rows.append({**row, "perplexity": round(perplexity, 1), "same_words": round(same, 3)})
        native.close()
    return rows, found


def main() -> int:
    """Measures and writes embedded.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", nargs="?", default=DEFAULT_MODEL)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--forms", action="store_true", help="measure other forms of it, too")
    args = parser.parse_args()
    model = find_model(args.model)
    source = cases()
    asked = [next(source) for _ in range(args.repeats)]
    figures, samples = asyncio.run(speed(model, asked))
    figures["model"] = model.stem
    batch, batch_samples = asyncio.run(together_or_alone(model, 1))
    rows, found = forms(model, asked, FORMS if args.forms else ())
    figures |= found | {name: batch[name] for name in TOGETHER}
    print(
        f"embedded: {figures['prompt_tokens_6']} tokens: cold {figures['cold_s_p50']:.2f} s, "
        f"warm {figures['warm_s_p50']:.2f} s, other link {figures['bandwidth_only_s_p50']:.2f} s; "
        f"16 together {figures['batch_speedup']:.2f} times as fast as one by one"
    )
    for row in rows:
        print("  " + ", ".join(f"{key} {value}" for key, value in row.items()))
    write_report("embedded", {**figures, "rows": rows}, {**samples, "together": batch_samples})
    return 0


if __name__ == "__main__":
    sys.exit(main())
