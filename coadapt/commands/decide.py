"""`coadapt decide --policy NAME < scene.json`: one decision."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from swarm.defaults import POLICY


def register(commands: Any) -> None:
    """Adds `decide` to the subparsers of `coadapt`."""
    parser = commands.add_parser(
        "decide",
        help="decide who takes part in the fusion, and how",
        description="Read a scene (JSON, see docs/decision.md) and print one decision as JSON.",
    )
    parser.add_argument(
        "scene",
        type=Path,
        nargs="?",
        metavar="SCENE.json",
        help="the scene (default: standard input)",
    )
    parser.add_argument(
        "--policy",
        default=POLICY,
        metavar="NAME",
        help="coverage, rules, static-early, ... (default: %(default)s); an unknown name lists all",
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="add what each robot adds and costs, and why it is in or out",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the decision. Raises DecisionError for a scene or a policy that cannot be used."""
    import msgspec

    from ego_agent.analyze.scene import analyze
    from ego_agent.analyze.scene_file import read_scene
    from ego_agent.plan.choices.explain import explain
    from ego_agent.plan.decision import plan
    from ego_agent.plan.policies.registry import make_policy

    case = read_scene(_read(args.scene), time.time_ns())
    policy = make_policy(args.policy, case.knowledge.algorithms)
    snapshot = case.snapshot
    scene = analyze(snapshot, case.knowledge)
    decision = plan(
        snapshot, scene, policy, case.knowledge, case.previous, snapshot.cycle, snapshot.now_ns
    )
    report = msgspec.to_builtins(decision)
    if args.explain:
        report["explanation"] = explain(scene, case.knowledge, decision)
    print(msgspec.json.encode(report).decode())
    return 0


def _read(path: Path | None) -> bytes:
    """The document. Raises DecisionError when the file cannot be read."""
    from swarm.errors import DecisionError

    if path is None:
        return sys.stdin.buffer.read()
    try:
        return path.read_bytes()
    except OSError as error:
        raise DecisionError(f"the scene {str(path)!r} cannot be read: {error.strerror}") from error
