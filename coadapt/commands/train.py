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
        "the end FOLDER/weights.safetensors holds what can be installed. Once they are, "
        "--calibrate measures what their scores mean, on worlds for nothing else.",
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
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help="calibrate the weights that are installed, instead of training",
    )
    parser.add_argument(
        "--frames",
        type=at_least_one,
        default=400,
        metavar="N",
        help="of --calibrate (default: 400)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Trains until the end (0) or until interrupted (130). Raises CoAdaptError for a wrong name,
    a folder with another run, or a device that is not there."""
    if args.calibrate:
        return _calibrate(args)

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
    print(f"  coadapt train --config {args.config} --calibrate")
    return 0


def _calibrate(args: argparse.Namespace) -> int:
    from perception.detector.weight_files import calibration_file
    from research.evaluation.calibration import calibrate
    from research.training.plans import plan

    made = calibrate(plan(args.config).config, args.frames, args.workers)
    for name, curve in made.curves.items():
        print(
            f"{name:22} precision {curve.precision:.3f} recall {curve.recall:.3f} "
            f"false {curve.false_per_frame:.2f} a frame, calibration error "
            f"{curve.calibration_error:.3f}"
        )
    print(f"wrote {calibration_file(args.config)}")
    return 0
