"""`python -m research.chaos`: plays faults on a real swarm, and judges it (docs/chaos.md).

Exit status 1 where something did not hold, with one line each and the command that plays it again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from deploy.progress import say
from research.chaos import isolation
from research.chaos.faults.base import Kind
from research.chaos.faults.clocks import step_s
from research.chaos.faults.registry import KINDS, KNOWN
from research.chaos.history import Fault, History
from research.chaos.invariants import Broken, broken, during
from research.chaos.outsider.lies import FOREIGN_BYTES
from research.chaos.play import play
from research.chaos.precision import precision
from research.chaos.report import report, write
from research.chaos.schedule import schedule
from research.chaos.stage import Stage, keep, swarm_stage
from research.chaos.watch import cycles, watching
from swarm.errors import CoAdaptError
from swarm.process import leave

MINUTES, FAULTS_A_MINUTE, ROBOTS, SEED = 1.5, 30.0, 5, 1
RECOVERY_CYCLES = 8
SETTLE_S = 3.0


def main(arguments: list[str]) -> int:
    """Runs it; 0 where everything held, 2 where it could not be run."""
    args = _parser().parse_args(arguments)
    try:
        kinds = _kinds(args.kinds, secure=args.secure)
        if not isolation.is_inside():
            return isolation.run_inside([*arguments, "--output", str(args.output.absolute())])
        isolation.prepare()
        return _run(args, kinds)
    except CoAdaptError as error:
        print(f"chaos: {error}", file=sys.stderr)
        return 2


def _run(args: argparse.Namespace, kinds: Mapping[str, Kind]) -> int:
    seconds = 60.0 * args.minutes
    count = args.faults or round(FAULTS_A_MINUTE * args.minutes)
    with swarm_stage(args.robots, args.policy, args.period, secure=args.secure) as stage:
        there = {"", *(["clocks"] if stage.clocks else []), *(["secure"] if args.secure else [])}
        can = {name: kind for name, kind in kinds.items() if kind.needs in there}
        faults = schedule(args.seed, seconds, count, stage.robots, list(can.values()))
        say(f"{len(faults)} faults of {len({f.kind for f in faults})} kinds in {seconds:.0f} s")
        history = _play(stage, faults, can, seconds, args.period)
        keep(stage, args.output.with_suffix(""))
    found = broken(history, args.recovery_cycles)
    options = [
        f"--seed {args.seed} --minutes {args.minutes:g} --faults {count} --robots {args.robots}",
        *([f"--kinds {args.kinds}"] if args.kinds else []),
        *(["--secure"] if args.secure else []),
    ]
    replay = f"make chaos ARGS='{' '.join(options)}'"
    left_out = sorted(kinds.keys() - can.keys())
    table = report(history, found, seed=args.seed, replay=replay, left_out=left_out)
    write(args.output, table)
    (args.output.with_suffix(".history.json")).write_bytes(msgspec.json.encode(history))
    _tell(history, found, replay, table)
    return 1 if found else 0


def _play(
    stage: Stage,
    faults: tuple[Fault, ...],
    kinds: Mapping[str, Kind],
    seconds: float,
    period: float,
) -> History:
    with watching(stage) as watch:
        played = play(stage, watch, faults, kinds, seconds)
        ended_s = watch.now_s()
        steps = [step_s(one.fault) for one in played if one.fault.kind == "clock-ego"]
        seen = precision(stage.spec, watch.kept)
        return History(
            seen=seen,
            seconds=ended_s,
            period_s=period,
            robots=stage.robots,
            played=played,
            cycles=cycles(watch, stage.journal, steps),
            decisions=tuple(watch.decisions),
            frames=tuple(watch.frames),
            memory=tuple(watch.memory),
            foreign_bytes=FOREIGN_BYTES,
        )


def _tell(
    history: History, found: tuple[Broken, ...], replay: str, table: Mapping[str, object]
) -> None:
    names = (
        "faults", "kinds", "cycles", "cycles_missed", "cycles_down", "recovery_cycles_max",
        "journal_lost", "hijacked", "ap_70", "ap_70_alone", "rss_slope_mb_per_h",
        "rss_slope_error_mb_per_h",
    )  # fmt: skip
    print(", ".join(f"{name} {table[name]}" for name in names))
    for one in found:
        where = during(history, one.at_s)
        print(f"BROKEN at {one.at_s:.1f} s during {where}: {one.rule}: {one.what}")
    if found:
        print(f"again: {replay}")


def _kinds(names: str, *, secure: bool) -> Mapping[str, Kind]:
    usual = [name for name in KINDS if secure or name not in KNOWN]
    chosen = names.split(",") if names else usual
    unknown = [name for name in chosen if name not in KINDS]
    if unknown:
        raise CoAdaptError(f"no kinds of faults: {', '.join(unknown)}; allowed: {', '.join(KINDS)}")
    return {name: KINDS[name] for name in chosen}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make chaos ARGS=...", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("--faults", type=int, help=f"default: {FAULTS_A_MINUTE:g} a minute")
    parser.add_argument(
        "--secure", action="store_true",
        help="a swarm with certificates; every other stranger has stolen one",
    )  # fmt: skip
    parser.add_argument("--robots", type=int, default=ROBOTS, help="with the ego")
    parser.add_argument("--policy", default="coverage")
    parser.add_argument("--period", type=float, default=1.0, help="of the ego's cycle, seconds")
    parser.add_argument("--kinds", default="", help="by commas; default: all")
    parser.add_argument(
        "--recovery-cycles", type=int, default=RECOVERY_CYCLES,
        help="so late everybody may be back (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--output", type=Path, default=Path("build/chaos.json"))
    return parser


if __name__ == "__main__":
    leave(main(sys.argv[1:]))
