"""`coadapt eval`: the experiments."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from coadapt.arguments import at_least_one, comma_separated
from swarm.messages import ALGORITHMS

FOLDER = Path("build/eval")
LIVE_POLICIES = ("static-early", "static-intermediate", "static-late", "coverage", "surrogate")
POLICIES = (
    "static-early", "static-intermediate", "static-late", "random", "rules", "coverage",
    "surrogate",
)  # fmt: skip


def register(commands: Any) -> None:
    """Adds `eval` to the subparsers of `coadapt`."""
    parser = commands.add_parser("eval", help="the experiments: policies side by side")
    experiments = parser.add_subparsers(metavar="EXPERIMENT", required=True)
    _add_policies(experiments)
    _add_live(experiments)
    _add_surrogate(experiments)
    _add_quality(experiments)
    _add_rates(experiments)
    _add_fit_rates(experiments)
    _add_ways(experiments)
    _add_driven(experiments)
    _add_oracle(experiments)
    published = experiments.add_parser(
        "published",
        help="what CoAdapt's published result files say",
        description="Reads the published selection.csv, eval.csv and eval_baseline.csv of CoAdapt "
        "(DIR/model/split/): means, what they support of the headline, and the decisions that the "
        "link could not have carried.",
    )
    published.add_argument("folder", type=Path, metavar="DIR")
    published.add_argument("--json", action="store_true", help="one object on standard output")
    published.set_defaults(run=run_published)


def _add_policies(experiments: Any) -> None:
    parser = experiments.add_parser(
        "policies",
        help="every policy side by side on the same control windows",
        description="Lets every policy decide in the same control windows of factory floors that "
        "nothing was trained on, or of a recorded world, measures what each choice brings, and "
        "compares with the best choice. Writes selection.csv, eval.csv, headline.json, report.md "
        "and figures.",
    )
    _add_policy_names(
        parser, POLICIES, "; random-judged draws, and is judged as a language model is"
    )
    parser.add_argument(
        "--algorithms", type=comma_separated, default=list(ALGORITHMS), metavar="NAMES",
        help=f"those that policies choose from (default: {','.join(ALGORITHMS)}, as an ego does)",
    )  # fmt: skip
    parser.add_argument(
        "--models", type=comma_separated, default=[], metavar="NAMES",
        help="language models to ask, comma-separated: smollm2-135m, a GGUF file, or NAME@URL of "
        "an OpenAI-compatible server (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--prompt", type=comma_separated, default=["table"], metavar="NAMES",
        help="how models are asked, comma-separated: table, our own; paper, in the manner of the "
        "paper; or short, for small models (default: table)",
    )  # fmt: skip
    parser.add_argument(
        "--scenarios", type=comma_separated, default=[], metavar="NAMES",
        help="comma-separated (default: all)",
    )  # fmt: skip
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="a recorded world in OPV2V's layout instead"
    )
    _add_compute(parser)
    _add_workers(parser)
    _add_folder(parser)
    parser.set_defaults(run=run_policies)


def _add_driven(experiments: Any) -> None:
    parser = experiments.add_parser(
        "driven",
        help="policies as an ego runs them: with memory, rates and a decision every second",
        description="Drives a window of each factory scenario with every policy, with what an ego "
        "remembers and with delays, and compares the default policy with its controls. Writes "
        "driven.json and driven.md.",
    )
    parser.add_argument(
        "--scenarios", type=comma_separated, default=[], metavar="NAMES",
        help="comma-separated (default: all)",
    )  # fmt: skip
    parser.add_argument(
        "--advised", action="store_true",
        help="also the embedded language model as it was trained, and its control",
    )  # fmt: skip
    _add_workers(parser)
    _add_folder(parser)
    parser.set_defaults(run=run_driven)


def _add_oracle(experiments: Any) -> None:
    parser = experiments.add_parser(
        "oracle",
        help="the best assignments that can be found by measuring, beside what is decided",
        description="Searches the assignments of a window of each factory scenario by what they "
        "bring, and compares what is decided with the best of them. Writes oracle.json and "
        "oracle.md.",
    )
    parser.add_argument(
        "--scenarios", type=comma_separated, default=[], metavar="NAMES",
        help="comma-separated (default: all)",
    )  # fmt: skip
    _add_workers(parser)
    _add_folder(parser)
    parser.set_defaults(run=run_oracle)


def _add_live(experiments: Any) -> None:
    parser = experiments.add_parser(
        "live",
        help="a few scenarios through a real swarm",
        description="Runs a swarm for each policy on two floors and two links, and compares what "
        "it delivers with the same choices without a network. Writes live.json and live.md.",
    )
    _add_policy_names(parser, LIVE_POLICIES)
    parser.add_argument(
        "--seconds", type=at_least_one, default=20, metavar="S",
        help="that each swarm is listened to (default: 20)",
    )  # fmt: skip
    parser.add_argument(
        "--runtime", choices=("auto", "docker", "netns"), default="auto",
        help="what swarms run in (default: auto)",
    )  # fmt: skip
    _add_compute(parser)
    _add_folder(parser)
    parser.set_defaults(run=run_live)


def _add_surrogate(experiments: Any) -> None:
    parser = experiments.add_parser(
        "train-surrogate",
        help="train the surrogate policy",
        description="Measures random choices on factory floors of its own and trains the network "
        "that predicts what a choice brings.",
    )
    _add_measuring(parser)
    parser.set_defaults(run=run_surrogate)


def _add_quality(experiments: Any) -> None:
    parser = experiments.add_parser(
        "fit-quality",
        help="fit what precision egos expect of what robots show",
        description="Measures random choices on floors or streets of their own and fits the line "
        "by which an ego predicts AP@0.7 of a choice.",
    )
    parser.add_argument(
        "--detector", choices=("factory", "road"), default="factory", help="default: %(default)s"
    )
    _add_measuring(parser)
    parser.set_defaults(run=run_quality)


def _add_rates(experiments: Any) -> None:
    parser = experiments.add_parser(
        "rates",
        help="measure what contributions bring that come less often",
        description="Drives factory floors and streets of their own with every algorithm at 10 to "
        "0.5 contributions a second. Writes rates.json.",
    )
    _add_drives(parser, floors=8, streets=4)
    _add_folder(parser)
    parser.set_defaults(run=run_rates)


def _add_fit_rates(experiments: Any) -> None:
    parser = experiments.add_parser(
        "fit-rates",
        help="fit what precision egos with memory expect, by form and rate",
        description="Drives floors and streets of their own with random robots, forms and rates, "
        "and fits the law by which an ego that remembers predicts AP@0.7 of assignments.",
    )
    _add_drives(parser, floors=40, streets=16)
    parser.add_argument("--law", type=Path, metavar="FILE", help="default: the one of the ego")
    parser.add_argument(
        "--quality", type=Path, metavar="FILE", help="default: the one of the ego"
    )  # fmt: skip
    parser.set_defaults(run=run_fit_rates)


def _add_drives(parser: argparse.ArgumentParser, *, floors: int, streets: int) -> None:
    for name, usual in (("floors", floors), ("streets", streets)):
        parser.add_argument(
            f"--{name}", type=at_least_one, default=usual, metavar="N", help="default: %(default)s"
        )
    parser.add_argument(
        "--frames", type=at_least_one, default=60, metavar="N",
        help="of each, one after the other (default: %(default)s)",
    )  # fmt: skip
    _add_workers(parser)


def _add_ways(experiments: Any) -> None:
    parser = experiments.add_parser(
        "ways",
        help="rates, mixed forms and memory, frame after frame",
        description="Drives factory floors that nothing was set on, and a recorded scenario in "
        "OPV2V's layout, with several forms, rates and codec settings, with memory and without. "
        "Writes ways.json.",
    )
    parser.add_argument(
        "--floors",
        type=at_least_one,
        default=6,
        metavar="N",
        help="half as many with noisy poses, and for each link (default: %(default)s)",
    )
    parser.add_argument(
        "--frames", type=at_least_one, default=50, metavar="N",
        help="of each, one after the other (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--data", type=Path, metavar="DIR", help="the recorded scenario")
    _add_workers(parser)
    _add_folder(parser)
    parser.set_defaults(run=run_ways)


def _add_measuring(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--windows", type=at_least_one, default=240, metavar="N",
        help="control windows to measure (default: 240)",
    )  # fmt: skip
    _add_workers(parser)
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: the one that the ego uses"
    )


def _add_policy_names(
    parser: argparse.ArgumentParser, default: Sequence[str], more: str = ""
) -> None:
    parser.add_argument(
        "--policies", type=comma_separated, default=list(default), metavar="NAMES",
        help=f"comma-separated (default: {','.join(default)}{more})",
    )  # fmt: skip


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--output", type=Path, default=FOLDER, metavar="DIR", help=f"default: {FOLDER}"
    )


def _add_compute(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--compute", type=Path, metavar="FILE",
        help="what encoding and fusing take, such as build/bench/compute.json (default: the model "
        "that comes with the project)",
    )  # fmt: skip


def _add_workers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers", type=at_least_one, default=os.cpu_count() or 1, metavar="N",
        help="processes (default: one a core)",
    )  # fmt: skip


def run_policies(args: argparse.Namespace) -> int:
    """Compares and writes. Raises CoAdaptError for unknown names or data that cannot be read."""
    from ego_agent.knowledge.compute import read_compute
    from research.evaluation.policies.run import compare
    from research.evaluation.published import found_published, summary
    from research.evaluation.windows.scenarios import chosen, factory_suite, recorded_suite

    suite = recorded_suite(args.data) if args.data else factory_suite()
    published = [summary(name, cycles) for name, cycles in found_published().items()]
    scenarios = chosen(suite, args.scenarios)
    compare(
        scenarios,
        args.policies,
        args.workers,
        args.output,
        algorithms=args.algorithms,
        models=args.models,
        prompts=args.prompt,
        published=published,
        compute=read_compute(args.compute) if args.compute else None,
    )
    return 0


def run_driven(args: argparse.Namespace) -> int:
    """Drives, writes and prints the tables. Raises EvaluationError for unknown names."""
    from research.evaluation.ways.driven import compare, report
    from research.evaluation.windows.scenarios import chosen, factory_suite

    suite = chosen(factory_suite(), args.scenarios)
    print(report(compare(suite, args.workers, args.output, advised=args.advised)))
    return 0


def run_oracle(args: argparse.Namespace) -> int:
    """Searches, writes and prints the table. Raises EvaluationError for unknown names."""
    from research.evaluation.ways.oracle import compare, report
    from research.evaluation.windows.scenarios import chosen, factory_suite

    suite = chosen(factory_suite(), args.scenarios)
    print(report(compare(suite, args.workers, args.output)))
    return 0


def run_live(args: argparse.Namespace) -> int:
    """Runs swarms and compares. Raises DeployError where none can run."""
    from ego_agent.knowledge.compute import read_compute
    from research.evaluation.live.run import live_suite
    from research.evaluation.live.run import run_live as run_all

    # A frame of which robots showed places only has no offline twin: what was asked about is not
    # published.
    os.environ.setdefault("COADAPT_BETWEEN", "false")
    compute = read_compute(args.compute) if args.compute else None
    run_all(live_suite(), args.policies, args.seconds, args.runtime, args.output, compute)
    return 0


def run_surrogate(args: argparse.Namespace) -> int:
    """Measures, trains and writes."""
    from ego_agent.plan.surrogate.model import WEIGHTS
    from research.evaluation.surrogate.train import train

    train(args.windows, args.workers, FOLDER, args.output or WEIGHTS)
    return 0


def run_quality(args: argparse.Namespace) -> int:
    """Measures, fits and writes."""
    from ego_agent.knowledge.quality import QUALITY
    from research.evaluation.surrogate.quality import fit_quality

    fit_quality(args.detector, args.windows, args.workers, FOLDER, args.output or QUALITY)
    return 0


def run_rates(args: argparse.Namespace) -> int:
    """Measures and writes. Raises EvaluationError for a process that ends before its work."""
    from research.evaluation.ways.rate_table import run

    run(_drives(args), args.frames, args.workers, args.output / "rates.json")
    return 0


def run_fit_rates(args: argparse.Namespace) -> int:
    """Measures, fits and writes. Raises EvaluationError as `run_rates` does."""
    from ego_agent.knowledge.quality import REMEMBERED
    from ego_agent.knowledge.rates import RATES
    from research.evaluation.ways.fit_rates import run

    law, quality = args.law or RATES, args.quality or REMEMBERED
    run(_drives(args), args.frames, args.workers, law, quality)
    return 0


def _drives(args: argparse.Namespace) -> dict[str, int]:
    return {"factory": args.floors, "road": args.streets}


def run_ways(args: argparse.Namespace) -> int:
    """Compares, writes and prints the figures. Raises CoAdaptError for data that cannot be read."""
    from research.evaluation.ways.run import run

    found = run(args.floors, args.frames, args.data, args.workers, args.output / "ways.json")
    print(json.dumps(found, indent=1))
    return 0


def run_published(args: argparse.Namespace) -> int:
    """Prints the tables. Raises EvaluationError for a folder that holds something else."""
    from research.evaluation.published import read_published, summary
    from research.evaluation.published_report import report

    makers = read_published(args.folder)
    if not args.json:
        print(report(makers))
        return 0
    document = {
        "rows": [asdict(summary(name, cycles)) for name, cycles in makers.items()],
        "infeasible": [
            {"decided_by": name, "needs_bps": cycle.needs_bps, **asdict(cycle)}
            for name, cycles in makers.items()
            for cycle in cycles
            if cycle.infeasible
        ],
    }
    print(json.dumps(document))
    return 0
