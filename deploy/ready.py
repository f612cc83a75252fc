"""Waiting until a swarm that has been started does its work."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Sequence

from deploy.observe import Watch
from deploy.progress import say
from deploy.runtime import ProcessStatus, Runtime
from deploy.state import State
from swarm.errors import CoAdaptError, DeployError

TAIL_LINES = 15
MAX_RESTARTS = 2
POLL_S = 0.5


def wait_ready(runtime: Runtime, state: State, timeout_s: float) -> None:
    """Returns once every robot is alive and senses, every ego has published a valid decision,
    and the cell has the rate that was asked for.

    Raises DeployError with the end of the log of a process that keeps ending, or that what was
    awaited did not come in time.
    """
    deadline = time.monotonic() + timeout_s
    robots = frozenset(state.spec.robots)
    egos = ", ".join(state.spec.all_egos)
    say(f"waiting for {len(robots)} robots and the first decision of {egos} ...")
    told = -1
    with _watch(runtime, state, deadline) as watch:
        while True:
            alive = watch.alive() & robots
            if len(alive) != told:
                told = len(alive)
                say(f"  {told} of {len(robots)} robots are alive")
            blind = robots - watch.sensing()
            shaped = state.spec.link_bps is None or watch.cell() is not None
            undecided = watch.undecided()
            if alive == robots and not blind and not undecided and shaped:
                say(f"  {egos} {'decide' if state.spec.egos else 'decides'}")
                return
            _check(runtime, state)
            if not shaped and (problems := watch.link_problems()):
                raise DeployError(
                    f"the link towards {state.spec.ego} cannot be given {state.spec.link_bps} "
                    f"bit/s: {'; '.join(problems)}; start without --link otherwise"
                )
            if time.monotonic() > deadline:
                raise _too_late(runtime, state, robots - alive, blind, undecided, shaped, timeout_s)
            watch.wait(POLL_S)


def _watch(runtime: Runtime, state: State, deadline: float) -> Watch:
    """A connection to the router, which may need a moment to listen."""
    while True:
        try:
            return Watch(state, timeout_s=POLL_S)
        except CoAdaptError as error:
            _check(runtime, state)
            if time.monotonic() > deadline:
                raise DeployError(
                    f"the router did not answer: {error}\n{_tail(runtime, state, 'router')}"
                ) from error


def _check(runtime: Runtime, state: State) -> None:
    """Raises DeployError when a process keeps ending."""
    for process in runtime.status(state.spec.swarm):
        if process.restarts >= MAX_RESTARTS or process.state == "stopped":
            raise DeployError(_failed(runtime, state, process))


def _failed(runtime: Runtime, state: State, process: ProcessStatus) -> str:
    return (
        f"{process.service} does not keep running: {process.detail}\n"
        f"{_tail(runtime, state, process.service)}"
    )


def _too_late(
    runtime: Runtime,
    state: State,
    missing: frozenset[str],
    blind: frozenset[str],
    undecided: Sequence[str],
    shaped: bool,
    timeout_s: float,
) -> DeployError:
    if missing:
        what = f"{', '.join(sorted(missing))} did not join"
        service = f"robot-{min(missing)}"
    elif blind:
        what = f"{', '.join(sorted(blind))} sent no beacon"
        service = f"robot-{min(blind)}"
    elif not shaped:
        what = f"the link towards {state.spec.ego} was not shaped"
        service = "controller"
    else:
        what = f"{', '.join(undecided)} published no valid decision"
        service = f"ego-{undecided[0]}"
    tail = _tail(runtime, state, service)
    return DeployError(f"{what} within {timeout_s:.0f} s\n{tail}")


def _tail(runtime: Runtime, state: State, service: str) -> str:
    try:
        lines = deque(runtime.logs(state.spec.swarm, service, False), maxlen=TAIL_LINES)
    except DeployError as error:
        return f"(no log: {error})"
    head = f"last lines of {service}'s log:" if lines else f"{service} logged nothing"
    return "\n".join(itertools.chain([head], (f"  {line}" for line in lines)))
