"""What the console costs the ego: processor time of the ego process of a real swarm of six robots,
in turn without a console, with one that nobody looks at, and with one that shows a page's stream.

The viewer reads the stream and draws nothing: a browser on the same two cores would leave the ego
less of them, and what is asked here is what the console makes it do. Fusion runs once a second, so
that the machine keeps up and the ego's own work is the same in every turn; every second round goes
backwards, so that what drifts falls on all alike.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from deploy.state import State
from research.benchmarks.console_stage import viewers
from research.benchmarks.controller import cpu_s
from research.benchmarks.live import live_swarm, process_id
from research.benchmarks.processes import await_port, free_ports, process

SWARM = "bench-console-ego"
FUSION_HZ = "1"
TURNS = ("none", "idle", "looking")
SECONDS = 6.0
SETTLE_S = 2.0


def ego_shares(rounds: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Shares of one core, and the samples of every turn."""
    taken: dict[str, list[float]] = {turn: [] for turn in TURNS}
    settings = {"COADAPT_FUSION_RATE_HZ": FUSION_HZ}
    with live_swarm(SWARM, settings, rings=16) as state:
        ego = process_id(state, "ego_agent")
        for number in range(rounds):
            for turn in TURNS if number % 2 else reversed(TURNS):
                with ExitStack() as stack:
                    if turn != "none":
                        port = stack.enter_context(console(state))
                        if turn == "looking":
                            stack.enter_context(viewers(port, 1))
                    time.sleep(SETTLE_S)
                    begun, before = time.monotonic(), cpu_s(ego)
                    time.sleep(SECONDS)
                    taken[turn].append((cpu_s(ego) - before) / (time.monotonic() - begun))
    none, idle, looking = (np.array(taken[turn]) for turn in TURNS)
    figures = {
        "ego_cpu_share_added": round(float(np.median(looking - none)), 4),
        "ego_cpu_share_added_idle": round(float(np.median(idle - none)), 4),
        "ego_cpu_share": round(float(np.median(none)), 4),
        "ego_cpu_share_added_error": round(float(np.std(looking - none) / rounds**0.5), 4),
        "ego_rounds": rounds,
    }
    return figures, {f"ego_cpu_share_{turn}": np.round(taken[turn], 4).tolist() for turn in TURNS}


@contextmanager
def console(state: State) -> Iterator[int]:
    """A console of that swarm, on the host; its port."""
    port = free_ports(1)
    settings = {
        "COADAPT_ROUTER": state.router,
        "COADAPT_SWARM": state.spec.swarm,
        "COADAPT_EGO": state.spec.ego,
        "COADAPT_CONSOLE_PORT": str(port),
        "COADAPT_METRICS_PORT": "0",
        "COADAPT_LOG_LEVEL": "error",
    }
    with process("options.console", **settings):
        await_port(port)
        yield port
