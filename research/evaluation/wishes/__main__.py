"""`python -m research.evaluation.wishes`: the table of wishes, build/eval/wishes.json."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import ADAPTER, DEFAULT_MODEL, find_model
from llm_gateway.wishes.readers import CONTEXT, embedded_reader, running
from research.evaluation.wishes.score import score, summary
from research.evaluation.wishes.ways import RandomReader, Remembering, Way, checked, unchecked
from research.training.wishes.cases import WISHES, Case, cases
from swarm.errors import CoAdaptError
from swarm.log import make_logger

THREADS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures one model, and the controls."""
    parser = argparse.ArgumentParser(prog="eval-llm", description=__doc__)
    parser.add_argument(
        "--model",
        default="embedded",
        help="embedded, none, or NAME@URL of an OpenAI-compatible server (default: embedded)",
    )
    parser.add_argument("--wishes", type=Path, default=WISHES, metavar="FILE")
    parser.add_argument("--output", type=Path, default=Path("build/eval/wishes.json"))
    parser.add_argument("--show", action="store_true", help="print every wish that is not exact")
    args = parser.parse_args(arguments)
    asked = cases(args.wishes)
    rows = {}
    args.output.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        for name, way in ways(args.model, stack):
            rows[name] = measured(asked, way, show=args.show)
            print(name, json.dumps(rows[name]), flush=True)
            args.output.write_text(json.dumps({"model": args.model, "rows": rows}, indent=1) + "\n")
    return 0


def ways(model: str, stack: ExitStack) -> Iterator[tuple[str, Way]]:
    """The rows of the table, the product's first."""
    log = make_logger("eval-llm", level="critical")
    if model == "embedded":
        if not ADAPTER.is_file():
            raise CoAdaptError(f"there is no {ADAPTER}; make train-llm makes one")
        tuned = Remembering(stack.enter_context(embedded_reader(THREADS)))
        yield "tuned, checked", checked(tuned)
        yield "tuned, on its word", unchecked(tuned)
        base = LlamaCpp(find_model(DEFAULT_MODEL), 1, CONTEXT, THREADS, log)
        plain = Remembering(stack.enter_context(running(base, trained=False)))
        yield "untuned, checked", checked(plain)
        yield "untuned, on its word", unchecked(plain)
    elif model != "none":
        from llm_gateway.backends.openai import OpenAi

        name, _, url = model.rpartition("@")
        backend = OpenAi(url, name, "", 1, log)
        server = Remembering(stack.enter_context(running(backend, trained=False)))
        yield f"{name or url}, checked", checked(server)
        yield f"{name or url}, on its word", unchecked(server)
    yield "rules only", checked(None)
    yield "random, checked", checked(RandomReader(1))
    yield "random, on its word", unchecked(RandomReader(1))


def measured(asked: Sequence[Case], way: Way, *, show: bool) -> dict[str, float | None]:
    """A row."""
    scores = []
    for case in asked:
        intent = way(case)
        one = score(case, intent)
        scores.append(one)
        if show and not one.exact:
            print(f"  {case.id} {case.wish!r} wrong: {one.wrong} unclear: {intent.unclear}")
    return summary(asked, scores)


if __name__ == "__main__":
    raise SystemExit(main())
