"""The interface of a runtime: what starts, watches and ends a swarm's processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

from deploy.spec import SwarmSpec

ProcessState = Literal["running", "restarting", "stopped"]


@dataclass(frozen=True, slots=True)
class ProcessStatus:
    """One service as the runtime sees it."""

    service: str
    state: ProcessState
    restarts: int
    """How often it was started again since `up`."""
    uptime_s: float
    """Since its last start; 0 when it does not run."""
    detail: str = ""
    """Why it does not run, or how it last ended."""


class Runtime(Protocol):
    """Starts the services of `deploy.services` and keeps them running.

    A runtime keeps `state.json` (`deploy.state`) in the run directory while its swarm exists, so
    that every command finds the swarm by its name alone.
    """

    name: str

    def available(self) -> str | None:
        """None when this machine can run it, else the reason why not and what would help."""
        ...

    def up(self, spec: SwarmSpec) -> bool:
        """Starts a swarm and returns once its processes have been started.

        Returns False when the same swarm already runs. Raises DeployError when another
        specification runs under this name, a port is taken, or a process cannot be started;
        nothing is left half-started then.
        """
        ...

    def down(self, swarm: str) -> bool:
        """Ends a swarm and removes all that it made but `var_dir`, also after a crash.

        Returns False when there was nothing to end.
        """
        ...

    def status(self, swarm: str) -> tuple[ProcessStatus, ...]:
        """The services in the order of `deploy.services`. Raises DeployError when none runs."""
        ...

    def logs(self, swarm: str, service: str, follow: bool) -> Iterator[str]:
        """The lines of one service's log, without line ends; with `follow`, also those to come
        until the swarm ends. Raises DeployError for an unknown service."""
        ...
