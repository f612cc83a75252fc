"""`coadapt record`: write what a running swarm does as MCAP, for Foxglove and for replaying."""

from __future__ import annotations

import argparse
import time
from importlib import resources
from pathlib import Path

from coadapt.arguments import add_ego, add_swarm
from coadapt.elsewhere import ELSEWHERE, add_router, state_of
from deploy.paths import RECORDINGS
from deploy.progress import say
from deploy.state import State, read_state
from swarm.errors import CoAdaptError, RecordingError
from swarm.process import stop_on_signals
from worlds.registry import world_kind

LIVE_PORT = 8765


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `record` to the command line."""
    parser = subparsers.add_parser("record", help="record a swarm as MCAP", description=__doc__)
    parser.add_argument(
        "output",
        nargs="?",
        type=Path,
        metavar="FILE.mcap",
        help="a new file (default: var/<swarm>/recordings/<time>.mcap)",
    )
    add_ego(parser)
    add_swarm(parser)
    add_router(parser)
    parser.add_argument("--seconds", type=float, help="how long (default: until Ctrl-C)")
    parser.add_argument(
        "--points",
        choices=("none", "selected", "all"),
        default="all",
        help="whose scans: nobody's, of those that take part, or everybody's (default: all)",
    )
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="frames a second with scans (default: all)"
    )
    parser.add_argument(
        "--whole",
        action="store_true",
        help="every point of a scan for viewers, in place of some: seven times as large",
    )
    parser.add_argument("--no-truth", action="store_true", help="leave out what is really there")
    parser.add_argument(
        "--ros2", action="store_true", help="fused objects as ROS 2 messages, too (docs/ros2.md)"
    )
    parser.add_argument(
        "--live",
        nargs="?",
        type=int,
        const=LIVE_PORT,
        metavar="PORT",
        help=f"serve Foxglove on 127.0.0.1, too (default port: {LIVE_PORT})",
    )
    parser.add_argument("--no-file", action="store_true", help="only --live: write no file")
    parser.add_argument(
        "--layout", action="store_true", help="print the layout to import in Foxglove, and end"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Records until the time is up, Ctrl-C, or the swarm is gone; the file is whole every time."""
    if args.layout:
        print(
            resources.files("options.recordings").joinpath("foxglove-layout.json").read_text(),
            end="",
        )
        return 0
    if args.no_file and args.live is None:
        raise RecordingError("--no-file without --live would record nothing: give --live")
    if args.seconds is not None and not args.seconds > 0:
        raise RecordingError(f"--seconds {args.seconds} cannot be used; it must be above 0")
    try:
        from options.recordings.record import Wanted, record
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "foxglove":
            raise
        raise RecordingError(
            "the package foxglove-sdk is missing: run `make setup`, or "
            "pip install 'coadapt-edge[recordings]'"
        ) from error
    state = state_of(args)
    _check_seen(args, state)
    output = None if args.no_file else (args.output or _default(state))
    stop = stop_on_signals()
    where = "no file" if output is None else str(output)
    say(f"recording swarm {args.swarm!r} to {where}; Ctrl-C ends it")
    result = record(
        state,
        Wanted(
            output=output,
            points=args.points,
            whole=args.whole,
            truth=not args.no_truth,
            rate_hz=args.rate,
            seconds=args.seconds,
            live_port=args.live,
            ros=args.ros2,
        ),
        stop,
        say,
        lambda: _gone(state),
    )
    say(f"ended: {result.ended}")
    if result.lost or result.left_out:
        say(
            f"{result.left_out} frames are without scans, and {result.lost} messages were lost: "
            "this machine could not keep up, or scans could not be had (see /log); "
            "--rate, or --points selected with --no-truth, makes less work"
        )
    print(
        f"{where}: {result.seconds:.0f} s, {result.fused} fused frames, {result.frames} with "
        f"scans, {result.bytes / 1e6:.1f} MB"
    )
    if result.path is not None:
        print(f"next: coadapt replay {result.path}, or open it in Foxglove (docs/recordings.md)")
    return 0


def _check_seen(args: argparse.Namespace, state: State) -> None:
    """Raises RecordingError where scans are wanted that are not on this machine."""
    kind = world_kind(state.spec.world)
    if state.runtime == ELSEWHERE and kind.data and args.points != "none":
        raise RecordingError(
            f"the scans of world {kind.name} are where the swarm runs: --points none records what "
            "is said"
        )


def _default(state: State) -> Path:
    name = time.strftime("%Y%m%dT%H%M%SZ.mcap", time.gmtime())
    return Path(state.spec.var_dir) / RECORDINGS / name


def _gone(state: State) -> bool:
    """Whether the swarm was taken down, or is another one by now."""
    if state.runtime == ELSEWHERE:
        return False  # The recorder sees by itself that nothing comes any more.
    try:
        now = read_state(state.spec.swarm)
    except CoAdaptError:
        return False
    return now is None or now.spec.epoch_ns != state.spec.epoch_ns
