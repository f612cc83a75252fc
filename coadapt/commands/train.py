"""`coadapt train`: trains a detector on its simulated world."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from coadapt.arguments import at_least_one


def register(commands: Any) -> None:
    """Adds `train` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "train",
        help="train a detector",
        description="Trains a detector on simulated scans alone. Progress goes to standard error, "
        "the curve to FOLDER/curve.jsonl. Interrupt at any point; the same command goes on. At "
        "the end FOLDER/weights.safetensors holds what can be installed.",
    )
    parser.add_argument("--config", required=True, metavar="NAME", help="factory or road")
    parser.add_argument(
        "--folder", type=Path, metavar="FOLDER", help="default: build/train/<config>"
    )
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument(
        "--steps", type=at_least_one, metavar="N", help="instead of the plan's (another run)"
    )
    parser.add_argument(
        "--workers",
        type=at_least_one,
        default=1,
        metavar="N",
        help="processes that make samples (default: 1; about 12 for a GPU)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Trains until the end (0) or until interrupted (130). Raises CoAdaptError for a wrong name,
    a folder with another run, or a device that is not there."""
    import torch

    from perception.detector.weight_files import weight_file
    from research.training.plans import plan
    from research.training.run import Run
    from swarm.errors import PerceptionError

    if args.device == "cuda" and not torch.cuda.is_available():
        raise PerceptionError("device 'cuda' is not available; allowed here: cpu")
    chosen = plan(args.config)
    if args.steps is not None:
        chosen = replace(chosen, steps=args.steps)
    training = Run(chosen, args.folder or Path("build/train") / args.config, args.device)
    if not training.train(args.workers):
        print(f"stopped after step {training.step} of {chosen.steps}; the same command goes on")
        return 130
    print(f"wrote {training.weights}; to use them:")
    print(f"  cp {training.weights} {weight_file(args.config)}")
    return 0
