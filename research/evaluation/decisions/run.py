"""Language models that decide by the short prompt, beside all that know less or more.

`python -m research.evaluation.decisions.run [--scenes N] [--examples N] [--free] [MODEL ...]`
writes `build/eval/llm.json`: a row for each model (a name, a GGUF file or NAME@URL) and for each
control. docs/evaluation.md says what the figures mean.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import islice
from pathlib import Path
from statistics import mean
from typing import Any

from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.policies.surrogate import BySurrogate
from ego_agent.plan.prompting.short import make_short_prompt, short_options
from llm_gateway.backends.llamacpp.models import ADAPTER, DEFAULT_MODEL
from research.evaluation.decisions.choosers import (
    ByModel,
    ByOption,
    ByPolicy,
    Case,
    Chooser,
    Oracle,
    as_json,
    at_random,
    by_rule,
    first_k,
)
from research.evaluation.decisions.measure import cases, row
from research.evaluation.machine import machine_facts
from research.evaluation.policies.advice import MADE_FROM, Model
from research.evaluation.result_store import ResultStore
from research.evaluation.tables import markdown
from research.training.decisions.examples import taught
from research.training.decisions.network import Lesson, learn
from research.training.decisions.scenes import TEST, TRAINING, known, scene_groups
from swarm.errors import CoAdaptError
from swarm.files import write_whole

SCENES, EXAMPLES, SEED = 60, 3_000, 1
REPORT = Path("build/eval/llm.json")
KEPT = Path("build/eval/kept")
SHOWN = (
    "chooser", "equal_to_coverage", "link_steps_followed", "value_lost", "judged_equal",
    "judged_value_lost", "readable", "prompt_tokens_p50", "answer_tokens_p50", "ms_p50",
)  # fmt: skip


def network(examples: int) -> tuple[ByOption, dict[str, Any]]:
    """The small network, taught as many examples as a language model would be; and its size."""
    knowledge = known()
    drawn = islice((scene for group in scene_groups(TRAINING, SEED) for scene in group), examples)
    lessons = []
    for scene in drawn:
        scorer = Scorer(scene, knowledge)
        short, groups, _ = taught(scorer)
        options = short_options(scorer, short)
        if groups in options:
            lessons.append(Lesson(short, options, groups))
    chooser = learn(lessons, SEED)
    about = {"examples": len(lessons), "parameters": chooser.parameter_count}
    return ByOption("small network", chooser.choose), about


def prompts(asked: list[Case]) -> dict[str, Any]:
    """How long prompts are, in characters."""
    sizes = [
        sum(
            len(message.content)
            for message in make_short_prompt(
                case.scorer.scene, case.scorer.knowledge, None, None, scorer=case.scorer
            ).messages
        )
        for case in asked
    ]
    return {"prompt_characters": round(mean(sizes)), "prompt_characters_most": max(sizes)}


def main() -> int:
    """Measures and writes the report."""
    parser = argparse.ArgumentParser(prog="python -m research.evaluation.decisions.run")
    parser.add_argument("--scenes", type=int, default=SCENES, help="each at five rates")
    parser.add_argument("--examples", type=int, default=EXAMPLES, help="for the small network")
    parser.add_argument("--free", action="store_true", help="ask models without a grammar, too")
    parser.add_argument(
        "--adapter", type=Path, default=ADAPTER, help="with what smollm2-135m is asked, too: GGUF"
    )
    parser.add_argument("models", nargs="*", metavar="MODEL")
    args = parser.parse_args()
    asked = cases(TEST, SEED, args.scenes)
    learned, about = network(args.examples)
    choosers: list[Chooser] = [
        at_random(SEED),
        ByOption("first k", first_k),
        ByOption("rule", by_rule),
        learned,
        ByPolicy("surrogate", BySurrogate()),
        ByPolicy("coverage", Coverage()),
        Oracle(),
    ]
    models: list[Model] = []
    try:
        kept = ResultStore(KEPT, MADE_FROM)
        models += [Model(name, kept) for name in args.models]
        if DEFAULT_MODEL in args.models:
            models.append(Model(DEFAULT_MODEL, kept, args.adapter))
        for model in models:
            choosers.append(ByModel(model))
            if args.free:
                choosers.append(ByModel(model, bound=False))
        rows, samples = [], {}
        for chooser in choosers:
            found, said = row(chooser, asked)
            rows.append(found)
            samples[chooser.name] = [as_json(one) for one in said]
            print(f"{chooser.name}: {found['equal_to_coverage']}", file=sys.stderr, flush=True)
    except CoAdaptError as error:
        print(f"decisions: {error}", file=sys.stderr)
        return 1
    finally:
        for model in models:
            model.close()
    report = {
        "rows": rows,
        "scenes": args.scenes,
        "rates_bps": TEST.rates_bps,
        "network": about,
        **prompts(asked),
        "machine": machine_facts(),
        "samples": samples,
    }
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    write_whole(REPORT, json.dumps(report).encode())
    print(markdown(SHOWN, [[one.get(name, "") for name in SHOWN] for one in rows]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
