"""`coadapt worlds`: which worlds there are, and whether recorded data will fuse."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm.errors import WorldError
from swarm.process import ProcessSettings

if TYPE_CHECKING:
    from worlds.check import Check
    from worlds.kinds import WorldKind

_PROCESS = ProcessSettings()
SHOWN = 4
"""Robots a line names; --json has all."""


def register(commands: Any) -> None:
    """Adds `worlds` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "worlds",
        help="list worlds; check recorded data",
        description="Lists the worlds that robots can live in. `coadapt worlds check PATH` looks "
        "at recorded data.",
    )
    parser.set_defaults(run=run_list)
    actions = parser.add_subparsers(metavar="ACTION")
    look = actions.add_parser(
        "check",
        help="tell what recorded data holds and whether it will fuse",
        description="Tells what lies in a folder (robots' bags, plain scans, a scenario of OPV2V) "
        "or file (a recording), how its times and clocks are, how far its robots are apart, and "
        "whether the detector suits. The exit status is 0 where it will fuse, else 1.",
    )
    look.add_argument("path", type=Path, metavar="PATH", help="a folder, or a recording's file")
    look.add_argument("--ego", help="the robot that fuses (default: the first)")
    look.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    look.set_defaults(run=run_check)


def run_list(_: argparse.Namespace) -> int:
    """Prints each world with its data."""
    from worlds.registry import world_kinds

    for kind in world_kinds().values():
        print(f"{kind.name:10}  {kind.needs or 'simulated'}")
    return 0


def run_check(args: argparse.Namespace) -> int:
    """Prints what was found. Returns 0 where it will fuse.

    Raises WorldError where nothing is found, or what was found cannot be opened.
    """
    from worlds.check import check
    from worlds.registry import find_kind, open_world

    kind, words = find_kind(args.path)
    try:
        found = check(open_world(kind.name, data=args.path), args.ego)
    except WorldError as error:
        raise WorldError(f"{args.path} holds {words} (world {kind.name}), but {error}") from error
    if args.json:
        about = {"path": str(args.path), "found": words, "world": kind.name, "fuses": found.fuses}
        print(json.dumps(about | asdict(found) | {"next": _next(kind, args.path, found)}))
    else:
        for name, text in _lines(kind, words, args.path, found):
            print(f"{name:9} {text}")
    return 0 if found.fuses else 1


def _lines(kind: WorldKind, words: str, path: Path, found: Check) -> list[tuple[str, str]]:
    first = (
        f"{found.frames} frames at {found.rate_hz:g} Hz, {found.span_s:.1f} s; all robots at once "
        f"for {max(0.0, found.overlap_s):.1f} s"
    )
    lines = [
        ("found", f"{words} (world {kind.name})"),
        ("robots", f"{_some(found.robots)}; ego {found.ego}"),
        ("time", first),
        ("scans", _some([_timed(found, robot) for robot in found.robots])),
        ("clocks", _clocks(found)),
        ("sensors", str(found.scans) if found.scans else "too little in the scans to tell"),
        ("detector", f"{found.detector}: {'; '.join(found.unsuited) or 'it suits'}"),
        ("distance", _distances(found)),
        ("coverage", f"together {found.gain:.2f} times what {found.ego} sees alone"),
    ]
    if found.apart:
        why = "do their poses count from one origin (origin in world.toml)?"
        lines.append(("origins", f"{_some(found.apart)}: {why}"))
    lines += [("damaged", fault) for fault in found.unreadable]
    lines += [("note", note) for note in found.notes]
    if found.fuses:
        best = max(one.within for one in found.partners)
        lines.append(("fuses", f"yes, in {best:.0%} of the frames that were looked at"))
    else:
        lines.append(("fuses", f"no: {'; '.join(found.against)}"))
    return [*lines, ("next", _next(kind, path, found))]


def _timed(found: Check, robot: str) -> str:
    seen = f"in {found.seen[robot]:.0%} of frames"
    for one in found.timings:
        if one.robot == robot:
            rate = f" at {one.rate_hz:.1f} Hz" if one.rate_hz else ""
            return f"{robot} {one.scans}{rate}, {one.lost} lost, {seen}"
    return f"{robot} {seen}"


def _clocks(found: Check) -> str:
    if found.skew is not None:
        robot, ahead_s = found.skew
        return (
            f"that of {robot} may be {abs(ahead_s):.2f} s {'ahead' if ahead_s > 0 else 'behind'} "
            "(clock_offset_s in world.toml)"
        )
    return "no skew seen" if found.timings else "the data does not say when each scan was taken"


def _distances(found: Check) -> str:
    told = [f"{p.robot} {p.nearest_m:.1f} to {p.farthest_m:.1f} m" for p in found.partners]
    return f"{_some(told) or 'nobody else'}; range {found.comm_range_m:g} m"


def _next(kind: WorldKind, path: Path, found: Check) -> str:
    from deploy.progress import typed

    if not found.fuses:
        what = "`damaged` and `fuses` say" if found.unreadable else "`fuses` says"
        return f"mend what {what}, and check again"
    if len(found.robots) > _PROCESS.world_robots:
        return typed("up", world=kind.name, data=path, robots=len(found.robots))
    return typed("up", world=kind.name, data=path)


def _some(names: Any) -> str:
    names = list(names)
    more = f", and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
