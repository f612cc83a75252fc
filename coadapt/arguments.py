"""Arguments that several subcommands share."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from perception.fusion.algorithms import all_fusions
from swarm.defaults import ALGORITHM, SWARM

if TYPE_CHECKING:
    from coadapt.recorded import Recorded
    from perception.fusion.base import Fusion


def at_least_zero(text: str) -> float:
    """A finite number >= 0, or argparse's error."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number >= 0")
    return value


def at_least_one(text: str) -> int:
    """A whole number >= 1, or argparse's error."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number >= 1")
    return int(text)


def comma_separated(text: str) -> list[str]:
    """The names between the commas, each once."""
    return list(dict.fromkeys(name for name in text.split(",") if name))


def add_swarm(parser: argparse.ArgumentParser) -> None:
    """Adds --swarm, by whose name every command finds a running one."""
    parser.add_argument("--swarm", default=SWARM, help="name of the swarm (default: %(default)s)")


def add_ego(parser: argparse.ArgumentParser) -> None:
    """Adds --ego, for swarms in which several robots decide."""
    parser.add_argument("--ego", metavar="ROBOT", help="which ego (default: the first)")


def add_algorithm(parser: argparse._ActionsContainer) -> None:
    """Adds --algorithm."""
    parser.add_argument(
        "--algorithm",
        default=ALGORITHM,
        metavar="NAME",
        help=f"{', '.join(all_fusions())}; single is the ego alone (default: %(default)s)",
    )


def add_recorded_fusion(parser: argparse.ArgumentParser) -> None:
    """Adds what is fused and how: DATA, --algorithm or --opencood, --ego, --pose-noise, --delay and
    --json."""
    parser.add_argument(
        "data",
        type=Path,
        nargs="?",
        metavar="DATA",
        help="a recording of a swarm (.mcap, by `coadapt record`), a directory in OPV2V's layout, "
        "or a folder of robots' bags or scans "
        "(default: the sample that `coadapt data` brings)",
    )
    how = parser.add_mutually_exclusive_group()
    add_algorithm(how)
    how.add_argument(
        "--opencood",
        type=Path,
        metavar="MODEL_DIR",
        help="an OpenCOOD model (config.yaml and a checkpoint), fused as it was trained for",
    )
    parser.add_argument("--ego", help="the robot that fuses (default: the first)")
    parser.add_argument(
        "--pose-noise",
        type=at_least_zero,
        default=0.0,
        metavar="M",
        help="standard deviation of the senders' poses, metres and degrees",
    )
    parser.add_argument(
        "--delay",
        type=at_least_zero,
        default=0.0,
        metavar="S",
        help="age of contributions, seconds; rounded to whole frames (0.1 s)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")


def recorded_data(args: argparse.Namespace) -> Recorded:
    """What `add_recorded_fusion` was given, else the sample. What is wrong with data that can be
    used all the same goes to standard error.

    Raises WorldError when there is none, or it cannot be used.
    """
    from coadapt.recorded import open_recorded
    from worlds.sample import opv2v_sample

    data = open_recorded(args.data or opv2v_sample())
    data.tell_notes()
    return data


def chosen_fusion(args: argparse.Namespace) -> str | Fusion:
    """What `add_recorded_fusion` was given: a name, or an OpenCOOD model's fusion.

    Raises PerceptionError for a model that cannot be used.
    """
    if args.opencood is None:
        return str(args.algorithm)
    from options.opencood.fusions import opencood_fusion
    from options.opencood.model import load

    return opencood_fusion(load(args.opencood))
