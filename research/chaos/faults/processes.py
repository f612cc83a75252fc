"""Processes that are killed, and processes that stand still."""

from __future__ import annotations

import signal

from research.chaos.faults.base import Begin, End, Kind
from research.chaos.history import Fault
from research.chaos.stage import Stage

EGO, ROUTER, CONTROLLER, CONSOLE, GATEWAY = "ego", "router", "controller", "console", "gateway"
AUTHORITY = "authority"


def service_of(part: str, stage: Stage, fault: Fault) -> str:
    """The supervisor's name for what a fault hits."""
    if part == EGO:
        return f"ego-{stage.spec.ego}"
    return part or f"robot-{fault.target}"


def _kill(part: str) -> Begin:
    def begin(stage: Stage, fault: Fault) -> End:
        service = service_of(part, stage, fault)
        stage.signal(service, signal.SIGKILL)
        return lambda: f"kill -9 of {service}"

    return begin


def _stop(part: str) -> Begin:
    def begin(stage: Stage, fault: Fault) -> End:
        service = service_of(part, stage, fault)
        stage.signal(service, signal.SIGSTOP)

        def end() -> str:
            stage.signal(service, signal.SIGCONT)
            return f"{service} stood still"

        return end

    return begin


NO_TIME = (0.0, 0.0)
STILL = (2.0, 4.0)
RESTART_S = 8.0
"""A process that is killed soon after its start waits longer before the next one: so a schedule
leaves it alone for a while."""

KINDS = (
    Kind(
        "kill-robot", _kill(""), NO_TIME, "target",
        targets=True, sign="process", rest_s=RESTART_S,
    ),
    Kind(
        "kill-ego", _kill(EGO), NO_TIME, "everybody", (EGO, "journal"),
        sign="decision", ego_down=True, rest_s=15.0,
    ),
    Kind(
        "kill-router", _kill(ROUTER), NO_TIME, "everybody", (ROUTER,),
        sign="anything", rest_s=RESTART_S,
    ),
    Kind(
        "kill-controller", _kill(CONTROLLER), NO_TIME, "nobody", (CONTROLLER,),
        sign="controller", rest_s=RESTART_S,
    ),
    Kind(
        "kill-authority", _kill(AUTHORITY), NO_TIME, "nobody", (AUTHORITY,),
        rest_s=RESTART_S, needs="secure",
    ),
    Kind("kill-console", _kill(CONSOLE), NO_TIME, "nobody", (CONSOLE,), rest_s=RESTART_S),
    Kind("kill-gateway", _kill(GATEWAY), NO_TIME, "nobody", (GATEWAY,), rest_s=RESTART_S),
    Kind("stop-robot", _stop(""), STILL, "target", targets=True, sign="beacon"),
    Kind(
        "stop-ego", _stop(EGO), STILL, "everybody", (EGO, "journal"),
        sign="decision", ego_down=True,
    ),
    Kind("stop-router", _stop(ROUTER), STILL, "everybody", (ROUTER,), sign="anything"),
    Kind("stop-controller", _stop(CONTROLLER), STILL, "nobody", (CONTROLLER,), sign="controller"),
    Kind("stop-console", _stop(CONSOLE), STILL, "nobody", (CONSOLE,)),
)  # fmt: skip
