"""Trains the adapter: `python -m research.training.wishes.train`."""

from __future__ import annotations

import argparse
import itertools
import json
import math
import random
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import nn

from ego_agent.plan.prompting.short import SYSTEM
from llm_gateway.backends.llamacpp.models import DEFAULT_MODEL, find_model
from llm_gateway.backends.llamacpp.native import Native
from llm_gateway.backends.llamacpp.requantise import convert
from research.training.decisions.examples import many
from research.training.wishes.batches import Batch, Lesson, batches, lesson
from research.training.wishes.cases import WISHES, cases
from research.training.wishes.export import export, restore
from research.training.wishes.llama import Llama, load
from research.training.wishes.lora import adapt
from research.training.wishes.samples import samples
from research.training.wishes.written import written
from swarm.messages import ChatMessage

NAME = "CoAdapt wishes and decisions"
BATCH = 16
RATE = 1e-3
WARM = 0.05
"""Part of the steps in which the learning rate rises."""
LEARNT = ("wishes-learnt.jsonl", "wishes-taught.jsonl")
"""Wishes that people wrote: by those of the first, cue words were widened, too."""
CHECKED = 256
"""Wishes of the validation split on which the loss is told."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Trains for so many minutes at most, and writes the adapter and what is known of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=80.0)
    parser.add_argument("--wishes", type=int, default=20_000)
    parser.add_argument("--decisions", type=int, default=25_600)
    parser.add_argument(
        "--passes", type=int, default=4, help="over the wishes that people wrote (default: 4)"
    )
    parser.add_argument("--start", type=Path, metavar="FILE", help="an adapter to go on from")
    parser.add_argument("--rate", type=float, default=RATE, help="of learning, at its highest")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/train-llm"))
    args = parser.parse_args(arguments)
    torch.manual_seed(args.seed)
    torch.set_num_threads(args.threads)
    args.out.mkdir(parents=True, exist_ok=True)
    base = find_model(DEFAULT_MODEL)
    native = Native(base, sequences=1, context=64, threads=1, chunk=32)
    lessons = wish_lessons(native, args.seed, "train", args.wishes)
    checks = wish_lessons(native, args.seed, "validate", CHECKED)
    decided = decision_lessons(native, args.seed, args.decisions, args.threads)
    by_people = written_lessons(native)
    lessons += decided + args.passes * by_people
    model = load(_readable(base, args.out)).to(args.device)
    trained = adapt(model)
    if args.start is not None:
        restore(model, args.start)
    card: dict[str, Any] = learn(model, trained, lessons, checks, args)
    card |= {
        "base": base.name, "seed": args.seed, "wishes": args.wishes, "written": len(by_people),
        "passes": args.passes, "decisions": len(decided),
        "parameters": sum(p.numel() for p in trained),
    }  # fmt: skip
    export(model, args.out / "adapter.gguf", name=NAME)
    (args.out / "training.json").write_text(json.dumps(card, indent=1) + "\n")
    return 0


def _readable(base: Path, folder: Path) -> Path:
    """The model in a form that is not quantised."""
    made = folder / "base.gguf"
    if not made.exists():
        convert(base, made, "BF16")
    return made


def wish_lessons(native: Native, seed: int, split: Any, count: int) -> list[Lesson]:
    """Generated wishes as lessons."""
    return [
        lesson(native, (ChatMessage(role="user", content=s.prompt),), s.answer)
        for s in itertools.islice(samples(seed, split), count)
    ]


def written_lessons(native: Native) -> list[Lesson]:
    """Wishes that people wrote, as lessons."""
    return [
        lesson(native, (ChatMessage(role="user", content=s.prompt),), s.answer)
        for name in LEARNT
        for s in written(cases(WISHES.with_name(name)))
    ]


def decision_lessons(native: Native, seed: int, count: int, processes: int) -> list[Lesson]:
    """Decisions of `coverage`, asked for by the short prompt, as lessons."""
    system = ChatMessage(role="system", content=SYSTEM)
    return [
        lesson(native, (system, ChatMessage(role="user", content=one.prompt)), one.answer)
        for one in many(seed, count, processes)
    ]


def learn(
    model: Llama,
    trained: Sequence[nn.Parameter],
    lessons: Sequence[Lesson],
    checks: Sequence[Lesson],
    args: argparse.Namespace,
) -> dict[str, float]:
    """One pass over the lessons, shorter where the time is up; returns the figures of the card."""
    chance = random.Random(args.seed)
    optimizer = torch.optim.AdamW(trained, lr=args.rate, weight_decay=0.0, betas=(0.9, 0.98))
    planned = math.ceil(len(lessons) / BATCH)
    begun = time.monotonic()
    done = 0
    step = 0
    model.train()
    for step, batch in enumerate(batches(lessons, BATCH, chance)):
        # The rate ends low whichever comes first, the last lesson or the last minute.
        gone = max(step / planned, (time.monotonic() - begun) / 60 / args.minutes)
        if gone >= 1:
            break
        warm = min(1.0, (step + 1) / (WARM * planned))
        for group in optimizer.param_groups:
            group["lr"] = args.rate * warm * max(0.02, 0.5 * (1 + math.cos(math.pi * gone)))
        loss = loss_of(model, batch, args.device)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(trained, 1.0)
        optimizer.step()
        optimizer.zero_grad(set_to_none=True)
        done += len(batch.tokens)
        if step % 50 == 0:
            rate = done / (time.monotonic() - begun)
            export(model, args.out / "adapter.gguf", name=NAME)
            print(f"step {step}/{planned} loss {loss.item():.4f} {rate:.1f}/s", flush=True)
    took = time.monotonic() - begun
    return {
        "steps": step, "examples": done, "minutes": round(took / 60, 1),
        "validation_loss": round(checked(model, checks, args.device), 4),
    }  # fmt: skip


def loss_of(model: Llama, batch: Batch, device: str) -> torch.Tensor:
    """The mean cross entropy of the answers' tokens; other tokens get no logits."""
    tokens, learned = batch.tokens.to(device), batch.learned.to(device)
    logits = model(tokens, learned)
    following = torch.roll(tokens, -1, dims=1)[learned]
    return nn.functional.cross_entropy(logits.float(), following)


@torch.no_grad()
def checked(model: Llama, checks: Iterable[Lesson], device: str) -> float:
    """The loss on lessons that were not learned."""
    model.eval()
    losses = [
        loss_of(model, batch, device).item()
        for batch in batches(list(checks), BATCH, random.Random(0))
    ]
    return sum(losses) / max(1, len(losses))


if __name__ == "__main__":
    raise SystemExit(main())
