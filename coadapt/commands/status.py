"""`coadapt status`: who is there, who takes part and why, and what the processes do."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from datetime import UTC, datetime

import msgspec

from coadapt.arguments import add_ego, add_swarm
from coadapt.elsewhere import ELSEWHERE, add_router, state_of
from deploy import runtimes
from deploy.observe import Watch
from deploy.rates import format_rate
from deploy.runtime import ProcessStatus
from deploy.state import State
from deploy.view import EgoRow, SwarmView
from swarm.errors import DeployError, TransportError
from swarm.messages import AdviceReport, Assignment, IntentTold

WINDOW_S = 1.2
REDRAW_S = 1.0
LATE_CYCLES = 4
_CLEAR = "\x1b[H\x1b[2J"


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `status` to the command line."""
    parser = subparsers.add_parser("status", help="show a swarm", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.add_argument("--watch", action="store_true", help="draw again every second")
    add_ego(parser)
    add_swarm(parser)
    add_router(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Listens for a moment and prints what came; with `--watch` until interrupted."""
    state = state_of(args)
    processes = _processes(state)
    try:
        connected = Watch(state)
    except TransportError as error:
        raise DeployError(
            f"the router of swarm {args.swarm!r} does not answer: {error}\n"
            + "\n".join(f"  {p.service} {p.state} {p.detail}".rstrip() for p in processes)
        ) from error
    with connected as watch:
        _listen(watch, state)
        while True:
            watch.ask_unheard()
            view = watch.view()
            if args.json:
                print(_json(view, processes, trusted(state)), flush=True)
            else:
                text = render(view, processes, trusted(state))
                print((_CLEAR if args.watch else "") + text, flush=True)
            if not args.watch:
                return 0
            time.sleep(REDRAW_S)
            processes = _processes(state)


def _processes(state: State) -> tuple[ProcessStatus, ...]:
    """What runs on this machine; of a swarm elsewhere nothing."""
    if state.runtime == ELSEWHERE:
        return ()
    return runtimes.get(state.runtime).status(state.spec.swarm)


def _listen(watch: Watch, state: State) -> None:
    """Long enough for the rates, and for one decision of each ego when they decide rarely, as many
    on a busy machine do."""
    begun = time.monotonic()
    late_s = state.spec.period_s * (LATE_CYCLES if state.spec.egos else 1)
    while (waited := time.monotonic() - begun) < WINDOW_S or (
        watch.undecided() and waited < WINDOW_S + late_s
    ):
        watch.wait(0.1)


class Trusted(msgspec.Struct, frozen=True):
    """Somebody who has a certificate of a secure swarm."""

    name: str
    hours_left: float
    revoked: bool


def trusted(state: State) -> list[Trusted] | None:
    """Who has a certificate; None in a plain swarm, and of one elsewhere, as its keystore is there.
    Raises IdentityError."""
    if not state.spec.secure or state.runtime == ELSEWHERE:
        return None
    # Only here: a plain swarm's status need not wait for the library.
    from deploy.trust.prepare import keystore_of

    now = datetime.now(UTC)
    return [
        Trusted(issued.name, (issued.end - now).total_seconds() / 3600, issued.revoked)
        for issued in keystore_of(state.spec.var_dir).issued()
    ]


def _json(
    view: SwarmView, processes: Sequence[ProcessStatus], trust: Sequence[Trusted] | None
) -> str:
    table = msgspec.to_builtins(view) | {
        "processes": msgspec.to_builtins(processes),
        "trust": msgspec.to_builtins(trust),
    }
    return msgspec.json.encode(table).decode()


def render(
    view: SwarmView, processes: Sequence[ProcessStatus], trust: Sequence[Trusted] | None = None
) -> str:
    """The table for people."""
    instead = f" IN THE STEAD OF {view.stands_in_for}" if view.stands_in_for else ""
    lines = [f"swarm {view.swarm} ({view.runtime}), ego {view.ego}{instead}", ""]
    lines += columns(
        [("robot", "alive", "age", "position", "distance", "selected", "bytes/s", "state")]
        + [
            (
                row.robot,
                "yes" if row.alive else "NO",
                "-" if row.age_s is None else f"{row.age_s:.1f} s",
                "-" if row.position is None else f"{row.position[0]:.1f}, {row.position[1]:.1f}",
                "-" if row.distance_m is None else f"{row.distance_m:.1f} m",
                "ego" if row.robot == view.ego else "yes" if row.selected else "",
                f"{row.bytes_per_s:,.0f}",
                ": ".join(filter(None, (row.state, row.why))),
            )
            for row in view.robots
        ]
    )
    lines += ["", *_decision(view)]
    lines += [f"links      {why}; C(t) is only measured there" for why in view.unshaped]
    if len(view.egos) > 1:
        lines += ["", *_egos(view.egos)]
    if view.model_trouble:
        lines.append(f"model      does not answer: {view.model_trouble}")
    if trust is not None:
        lines.append(f"trust      {_trust(trust)}")
    if not processes:
        return "\n".join(lines)
    lines.append("")
    lines += columns(
        [("process", "state", "restarts", "up", "")]
        + [
            (p.service, p.state, str(p.restarts), f"{p.uptime_s:.0f} s", p.detail)
            for p in processes
        ]
    )
    return "\n".join(lines)


def _decision(view: SwarmView) -> list[str]:
    if view.selected is None or view.capacity_bps is None:
        return ["decision   none came while listening"]
    cell = "" if view.cell_bps is None else f" (cell: {format_rate(view.cell_bps)}"
    if cell:
        cell += f", level {view.cell_level})" if view.cell_level else ")"
    valid = "" if view.valid else " (NOT VALID)"
    return [
        f"decision   cycle {view.cycle}: {view.algorithm} from {', '.join(view.selected)}{valid}",
        *([f"sends      {_assigned(view)}"] if view.assignments else []),
        *([f"BLIND      {view.blind}"] if view.blind else []),
        f"by         {view.policy} (source: {view.source})",
        *(f"wish       {_wish(intent)}" for intent in view.intents),
        f"reason     {view.reason}",
        *([f"advice     {_advice(view.advice)}"] if view.advice else []),
        f"link       {view.bytes_per_s:,.0f} bytes/s of C(t) = "
        f"{format_rate(view.capacity_bps)}{cell}; {view.frames_per_s:.1f} frames/s",
    ]


def _wish(intent: IntentTold) -> str:
    """An intent that the decision obeys, and what it did to it."""
    since = datetime.fromtimestamp(intent.since_ns * 1e-9, UTC).astimezone()
    text = f"{intent.number} of {intent.operator or 'unknown'} since {since:%H:%M}: {intent.says}"
    return text + (f" ({'; '.join(intent.bound)})" if intent.bound else "")


def _assigned(view: SwarmView) -> str:
    """Who sends what, and how often."""

    def rates(one: Assignment) -> str:
        notes = ["objects"] if one.objects_only else []
        notes += [f"places: {one.places_hz:g} Hz"] if one.places_hz else []
        return f"{one.rate_hz:g} Hz" + (f" ({'; '.join(notes)})" if notes else "")

    return ", ".join(f"{one.robot} {one.algorithm} {rates(one)}" for one in view.assignments)


def _egos(egos: Sequence[EgoRow]) -> list[str]:
    """What each ego has decided, where there are several."""
    return columns(
        [("ego", "cycle", "age", "Q", "policy", "algorithm", "from")]
        + [
            (row.ego, "-", "-", "-", "", "no decision came", "")
            if row.cycle is None or row.age_s is None
            else (
                row.ego,
                str(row.cycle),
                f"{row.age_s:.1f} s",
                f"{row.quality:.2f}",
                row.policy,
                row.algorithm if row.valid else f"{row.algorithm} (NOT VALID)",
                ", ".join(row.selected),
            )
            for row in egos
        ]
    )


def _trust(trust: Sequence[Trusted]) -> str:
    """Who is trusted, in one line."""
    good = [one for one in trust if not one.revoked and one.hours_left > 0]
    text = ", ".join(one.name for one in good) or "nobody"
    if good:
        first = min(good, key=lambda one: one.hours_left)
        text += f" (by certificate; that of {first.name} ends first, in {first.hours_left:.1f} h)"
    revoked = ", ".join(one.name for one in trust if one.revoked)
    return text + (f"; revoked: {revoked}" if revoked else "")


def _advice(advice: AdviceReport) -> str:
    """How the ego stands with its language model, in one line."""
    if advice.age_s is not None:
        text = f"{advice.state} {advice.age_s:.0f} s: {advice.model}"
    else:
        text = advice.state
    if not advice.gateway:
        text += ", no LLM gateway is connected"
    elif advice.asked_s is not None:
        text += f", asked {advice.asked_s:.0f} s ago (question {advice.question})"
    return text + (f"; last: {advice.refusal}" if advice.refusal else "")


def columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Rows of cells as lines whose cells stand below each other."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
