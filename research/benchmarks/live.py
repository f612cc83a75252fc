"""A real swarm in network namespaces, to be measured or shown."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import factory_robots, make_spec
from deploy.state import State, need_state
from research.benchmarks.ending import signals_raise
from research.benchmarks.processes import free_ports

ROBOTS = 6
READY_S = 180.0


def why_not() -> str | None:
    """Why no swarm can be started here, or None."""
    return NetnsRuntime().available()


@contextmanager
def live_swarm(swarm: str, settings: Mapping[str, str], **values: Any) -> Iterator[State]:
    """Six robots on a wide link, once the ego decides; `settings` are those of its processes, and
    `values` those of `make_spec` that are to be otherwise.

    Raises DeployError where it cannot be started; nothing of it is left then, nor when a signal
    ends this process.
    """
    runtime = NetnsRuntime()
    with signals_raise(), tempfile.TemporaryDirectory(prefix="cl-", dir="/tmp") as directory:
        before = dict(os.environ)
        os.environ.update(settings, COADAPT_RUN_DIR=directory)
        first = free_ports(5)
        usual: dict[str, Any] = {
            "robots": factory_robots(ROBOTS),
            "link_bps": 55_000_000,
            "prometheus": False,
            "ego_metrics_port": first,
            "qod_port": first + 1,
            "console_port": first + 2,
            "llm_port": first + 3,
            "prometheus_port": first + 4,
            "run_dir": f"{directory}/{swarm}",
            "var_dir": f"{directory}/var",
        }
        spec = make_spec(swarm=swarm, **(usual | values))
        try:
            runtime.up(spec)
            wait_ready(runtime, need_state(swarm), READY_S)
            yield need_state(swarm)
        finally:
            runtime.down(swarm)
            os.environ.clear()
            os.environ.update(before)


def process_id(state: State, module: str, **settings: str) -> int:
    """Of the process of a swarm that runs a module with settings."""
    marks = {
        f"{name}={value}".encode()
        for name, value in {"COADAPT_SWARM": state.spec.swarm, **settings}.items()
    }
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            environment = (entry / "environ").read_bytes().split(b"\0")
            if module.encode() in words and marks <= {*environment}:
                return int(entry.name)
        except OSError:
            continue  # It has ended, or is another user's.
    wanted = " with ".join([module, *(f"{name}={value}" for name, value in settings.items())])
    raise RuntimeError(f"no process of swarm {state.spec.swarm!r} runs {wanted}")
