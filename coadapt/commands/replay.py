"""`coadapt replay`: what a recording of a swarm holds, and whether it replays to the same."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

from deploy.progress import typed

SHOWN = 5
PROGRESS_S = 5.0
"""Between two lines of progress, where standard error is no terminal."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `replay` to the command line."""
    parser = subparsers.add_parser("replay", help="look into a recording", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE.mcap")
    parser.add_argument(
        "--check",
        action="store_true",
        help="fuse every recorded frame again, and compare with the recorded detections",
    )
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints what is in a file; with `--check`, ends with 1 when no frame comes out the same."""
    from options.recordings.file import RecordingFile

    file = RecordingFile(args.file)
    for note in file.notes:
        print(note, file=sys.stderr)
    facts = _facts(file)
    status = 0
    if args.check:
        from options.recordings.check import check
        from options.recordings.world import RecordingWorld

        result = check(RecordingWorld(args.file), _Progress())
        facts["check"] = msgspec.to_builtins(result)
        status = 0 if result.equal else 1
    print(msgspec.json.encode(facts).decode() if args.json else _text(facts))
    return status


class _Progress:
    """Tells on standard error how far it is: in place on a terminal, else a line now and then."""

    def __init__(self) -> None:
        self._told = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        text = f"  {done} of {of} frames"
        if sys.stderr.isatty():
            end = "\n" if done == of else ""
            print(f"\r{text}", end=end, file=sys.stderr, flush=True)
        elif done in (1, of) or time.monotonic() - self._told >= PROGRESS_S:
            self._told = time.monotonic()
            print(text, file=sys.stderr, flush=True)


def _facts(file: Any) -> dict[str, Any]:
    from options.recordings.format import FRAME, FUSED, Fused

    times = file.times(FRAME)
    fused = file.messages(FUSED, Fused)
    algorithms: dict[str, int] = {}
    for one in fused:
        algorithms[one.algorithm] = algorithms.get(one.algorithm, 0) + 1
    return {
        "file": str(file.path),
        "bytes": file.path.stat().st_size,
        "cut": bool(file.notes),
        **msgspec.to_builtins(file.header),
        "frames_with_scans": len(times),
        "seconds": round((times[-1] - times[0]) / 1e9, 3) if times else 0.0,
        "fused_frames": len(fused),
        "algorithms": algorithms,
        "topics": {
            topic: {"schema": file.topics[topic], "messages": file.count(topic)}
            for topic in sorted(file.topics)
        },
    }


def _text(facts: dict[str, Any]) -> str:
    began = time.strftime(
        "%Y-%m-%d %H:%M:%S UTC", time.gmtime(facts["started_ns"] // 1_000_000_000)
    )
    fused = ", ".join(f"{count} {name}" for name, count in facts["algorithms"].items())
    width = max(len(topic) for topic in facts["topics"])
    lines = [
        f"{facts['file']}: swarm {facts['swarm']} in world {facts['world']}, {began}, "
        f"{facts['bytes'] / 1e6:.1f} MB",
        f"robots   {', '.join(facts['robots'])}; ego {facts['ego']}",
        f"frames   {facts['frames_with_scans']} with scans ({facts['points']}) over "
        f"{facts['seconds']:g} s; {facts['fused_frames']} fused ({fused or 'none'})",
        *(
            f"  {topic:{width}}  {its['messages']:6}  {its['schema']}"
            for topic, its in facts["topics"].items()
        ),
    ]
    if "check" in facts:
        lines += _check_text(facts["check"])
    elif facts["frames_with_scans"]:
        lines.append(f"next: {typed('up', world='recording', data=facts['file'])}")
    return "\n".join(lines)


def _check_text(result: dict[str, Any]) -> list[str]:
    different = result["different"]
    lines = [
        f"check    {result['equal']} of {result['compared']} frames fuse to the recorded boxes "
        f"({result['boxes']} boxes, within {result['largest']:.1g})"
    ]
    if result["other_times"]:
        lines.append(
            f"  not compared: {result['other_times']} frames in which a robot answered with its "
            "scan before or after the recorded one"
        )
    if result["about_places"]:
        lines.append(
            f"  not compared: {result['about_places']} frames in which a robot was asked about "
            "the places of what was remembered, or for objects"
        )
    lines += [
        f"  frame {one['frame']}, {one['algorithm']}: {one['why']}" for one in different[:SHOWN]
    ]
    if len(different) > SHOWN:
        lines.append(f"  ... and {len(different) - SHOWN} more")
    return lines
