"""Fuzzes all targets, or one: `python -m research.fuzz`. Writes build/fuzz.json."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from research.fuzz.hunt import Hunt, hunt
from research.fuzz.targets import TARGETS

REPOSITORY = Path(__file__).resolve().parents[2]
CORPUS = REPOSITORY / "tests" / "fuzz" / "corpus"
BUILD = REPOSITORY / "build"
SECONDS = 120.0


def main(arguments: list[str] | None = None) -> int:
    """Returns 0 when nothing was found, 1 when something was, 2 when it cannot run here."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--target",
        action="append",
        help=f"one of {', '.join(TARGETS)}, or module:NAME of another one; may be repeated",
    )
    parser.add_argument("--seconds", type=float, default=SECONDS, help="in all, by the clock")
    parser.add_argument(
        "--seed", type=int, default=1, help="of chance (1); another one tries other inputs"
    )
    parser.add_argument("--build", type=Path, default=BUILD, help="folder of what is written")
    args = parser.parse_args(arguments)
    if importlib.util.find_spec("atheris") is None:
        print(
            f"fuzz: atheris is not installed. It has wheels for Python 3.11 to 3.13 on Linux on "
            f"x86-64; this is Python {platform.python_version()} on {platform.machine()}",
            file=sys.stderr,
        )
        return 2
    names = args.target or list(TARGETS)
    if unknown := [name for name in names if name not in TARGETS and ":" not in name]:
        parser.error(f"target {unknown[0]!r} is unknown; allowed: {', '.join(TARGETS)}")
    workers = min(os.cpu_count() or 1, len(names))
    each_s = args.seconds * workers / len(names)

    def one(name: str) -> Hunt:
        its, seeds = TARGETS.get(name, name), CORPUS / name
        found = hunt(name, its, each_s, args.seed, seeds, args.build / "fuzz")
        print(_line(found), flush=True)
        return found

    try:
        with ThreadPoolExecutor(workers) as pool:
            hunts = list(pool.map(one, names))
    except RuntimeError as error:
        print(f"fuzz: {error}", file=sys.stderr)
        return 2
    result = {
        "seed": args.seed,
        "executions": sum(found.executions for found in hunts),
        **{f"{kind}": sum(found.count(one) for found in hunts) for one, kind in _KINDS.items()},
        "targets": [found.row() for found in hunts],
    }
    args.build.mkdir(parents=True, exist_ok=True)
    (args.build / "fuzz.json").write_text(json.dumps(result, indent=2) + "\n")
    wrong = [(found, path) for found in hunts for path in found.findings]
    for found, path in wrong:
        finding = found.findings[path]
        print(f"fuzz: {found.target}: {finding.kind}: {finding.what}\n  {path}", file=sys.stderr)
    if wrong:
        print(f"fuzz: once mended, copy the inputs to {CORPUS}/<target>/", file=sys.stderr)
    return int(bool(wrong))


_KINDS = {"crash": "crashes", "hang": "hangs", "jump": "jumps"}


def _line(found: Hunt) -> str:
    counts = ", ".join(f"{found.count(one)} {many}" for one, many in _KINDS.items())
    return (
        f"{found.target}: {found.executions} inputs in {found.seconds:.0f} s, "
        f"{found.coverage} edges, {counts}"
    )


if __name__ == "__main__":
    sys.exit(main())
