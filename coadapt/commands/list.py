"""`coadapt list`: the swarms of this machine that are yours."""

from __future__ import annotations

import argparse
import time

import msgspec

from coadapt.commands.status import columns
from deploy import runtimes
from deploy.progress import typed
from deploy.state import read_state, swarms
from swarm.errors import DeployError


class Row(msgspec.Struct, frozen=True):
    """One swarm."""

    swarm: str
    runtime: str
    robots: int | None
    ego: str
    started: str
    """Local time; empty where the record cannot be read."""
    state: str
    console: str


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `list` to the command line."""
    parser = subparsers.add_parser("list", help="show your swarms", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints a line for each swarm that was started and not taken down."""
    rows = [_row(name) for name in swarms()]
    if args.json:
        print(msgspec.json.encode({"swarms": rows}).decode())
    elif not rows:
        print(f"no swarm is running; start one with `{typed('up')}`")
    else:
        heads = ("swarm", "runtime", "robots", "ego", "started", "state", "console")
        cells = [
            tuple("-" if cell in ("", None) else str(cell) for cell in msgspec.structs.astuple(row))
            for row in rows
        ]
        print("\n".join(columns([heads, *cells])))
    return 0


def _row(name: str) -> Row:
    try:
        state = read_state(name)
    except DeployError as error:
        return Row(name, "", None, "", "", str(error), "")
    if state is None:  # It has gone meanwhile.
        return Row(name, "", None, "", "", "gone", "")
    spec = state.spec
    started = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(spec.epoch_ns / 1e9))
    told = _state(name, state.runtime)
    return Row(name, state.runtime, len(spec.robots), spec.ego, started, told, state.console_url)


def _state(name: str, runtime: str) -> str:
    try:
        processes = runtimes.get(runtime).status(name)
    except DeployError as error:
        return str(error)
    ill = [f"{p.service} {p.state}" for p in processes if p.state != "running"]
    return f"runs, but {', '.join(ill)}" if ill else f"{len(processes)} processes run"
