"""`coadapt eval`: the experiments."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Adds `eval` to the subparsers of `coadapt`."""
    parser = commands.add_parser("eval", help="the experiments: policies side by side")
    experiments = parser.add_subparsers(metavar="EXPERIMENT", required=True)
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


def run_published(args: argparse.Namespace) -> int:
    """Prints the tables. Raises EvaluationError for a folder that holds something else."""
    from evaluation.published import read_published, summary
    from evaluation.published_report import report

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
