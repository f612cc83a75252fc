"""The runtime on network namespaces: needs neither a container engine nor root."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from deploy.netns import control, detached, launch
from deploy.netns.supervisor import ROUTER_SOCKET, place_of
from deploy.paths import FOLDERS, identity_path
from deploy.ports import listen_endpoints
from deploy.progress import typed
from deploy.runtime import ProcessStatus
from deploy.services import ego_metrics_url, services
from deploy.spec import SwarmSpec, run_dir_of
from deploy.state import (
    ProcessMark,
    State,
    check_same,
    exclusive,
    make_run_dir,
    need_state,
    read_state,
    remove_run_dir,
    write_state,
)
from swarm.errors import DeployError
from swarm.trust.roles import LOCAL

STOP_S = 15.0
FOLLOW_S = 0.2
LAUNCHER, RELAY = "launcher", "relay"
SUPERVISOR_LOG, RELAY_LOG = "supervisor.log", "relay.log"


class NetnsRuntime:
    """One supervisor a swarm, which is PID 1 of the swarm's namespaces; see
    `deploy.netns.supervisor`. Holds no state of its own."""

    name = "netns"

    def available(self) -> str | None:
        """None when namespaces can be made here, else the reason why not."""
        return launch.why_not()

    def up(self, spec: SwarmSpec) -> bool:
        """See `Runtime.up`."""
        with exclusive():
            if self._already_runs(spec):
                return False
            self._clear(spec.swarm)
            reason = self.available()
            if reason is not None:
                raise DeployError(f"runtime netns cannot run here: {reason}")
            if spec.prometheus and shutil.which("prometheus") is None:
                raise DeployError(
                    "the program `prometheus` is missing; install it (Debian: apt-get install "
                    "prometheus) or start with --no-prometheus"
                )
            if Path(spec.run_dir).resolve().is_relative_to("/run"):
                raise DeployError(
                    f"run directory {spec.run_dir} lies in /run, which the swarm's namespaces "
                    "cover; set COADAPT_RUN_DIR to another place"
                )
            self._start(spec)
            return True

    def down(self, swarm: str) -> bool:
        """See `Runtime.down`."""
        with exclusive():
            return self._clear(swarm)

    def status(self, swarm: str) -> tuple[ProcessStatus, ...]:
        """See `Runtime.status`; the host's relay comes last."""
        state = need_state(swarm)
        reply = control.ask(Path(state.spec.run_dir), control.Request("status"))
        if reply is None:
            raise DeployError(
                f"swarm {swarm!r} has crashed: its supervisor does not answer; "
                f"`{typed('up', swarm)}` starts it again, `{typed('down', swarm)}` clears it away"
            )
        listed = [
            ProcessStatus(s.service, s.state, s.restarts, s.uptime_s, s.detail)
            for s in reply.services
        ]
        relay = state.processes.get(RELAY)
        if relay is not None and not detached.is_alive(relay):
            listed.append(ProcessStatus(RELAY, "stopped", 0, 0.0, "127.0.0.1 reaches nothing"))
        return tuple(listed)

    def logs(self, swarm: str, service: str, follow: bool) -> Iterator[str]:
        """See `Runtime.logs`; `supervisor` and `relay` have a log, too."""
        spec = need_state(swarm).spec
        names = [s.name for s in services(spec, place_of(spec))] + ["supervisor", RELAY]
        if service not in names:
            raise DeployError(f"no process {service!r}; there are {', '.join(names)}")
        path = Path(spec.var_dir) / "logs" / f"{service}.log"
        return _lines(path, spec, follow)

    def kill(self, swarm: str, service: str, number: int) -> None:
        """Sends a signal to a service's process, as a crash would. Raises DeployError."""
        request = control.Request("kill", service, number)
        if control.ask(Path(need_state(swarm).spec.run_dir), request) is None:
            raise DeployError(f"the supervisor of swarm {swarm!r} does not answer")

    def _already_runs(self, spec: SwarmSpec) -> bool:
        state = read_state(spec.swarm)
        if (
            state is None
            or control.ask(Path(state.spec.run_dir), control.Request("status")) is None
        ):
            return False
        check_same(state, spec)
        return True

    def _start(self, spec: SwarmSpec) -> None:
        var_dir = Path(spec.var_dir)
        logs = var_dir / "logs"
        with contextlib.ExitStack() as stack:
            endpoints = stack.enter_context(listen_endpoints(spec))
            make_run_dir(spec)
            try:
                for folder in FOLDERS:
                    (var_dir / folder).mkdir(parents=True, exist_ok=True)
                logs.mkdir(parents=True, exist_ok=True)
                if spec.secure:
                    from deploy.trust.prepare import prepare

                    prepare(spec, place_of(spec), LOCAL)
                for old in logs.glob("*.log*"):
                    old.unlink()
                start = stack.enter_context(
                    contextlib.closing(launch.Launch(logs / SUPERVISOR_LOG))
                )
                marks = {LAUNCHER: start.mark}
                # Recorded before anything is built: `down` finds it even if this process dies.
                write_state(_state(spec, marks))
                start.start(spec)
                marks[RELAY] = launch.start_relay(spec, logs / RELAY_LOG, endpoints)
                write_state(_state(spec, marks))
            except OSError as error:
                self._clear(spec.swarm)
                raise DeployError(f"swarm {spec.swarm!r} cannot be started: {error}") from error
            except BaseException:
                self._clear(spec.swarm)
                raise

    @staticmethod
    def _clear(swarm: str) -> bool:
        run_dir = run_dir_of(swarm)
        if not run_dir.exists():
            return False
        try:
            state = read_state(swarm)
        except DeployError:
            state = None
        supervisor = control.connect(run_dir)
        if supervisor is not None:
            with supervisor, contextlib.suppress(OSError):
                supervisor.sendall(b'{"command": "stop"}\n')
                supervisor.settimeout(STOP_S)
                while supervisor.recv(65536):
                    pass
        for mark in state.processes.values() if state else ():
            if not detached.wait_gone(mark, 2.0 if supervisor else 0.0):
                detached.kill(mark)
                detached.wait_gone(mark, 2.0)
        return remove_run_dir(swarm)


def _state(spec: SwarmSpec, marks: dict[str, ProcessMark]) -> State:
    shown = f"#identity={identity_path(spec.var_dir, LOCAL.common_name)}" if spec.secure else ""
    return State(
        runtime="netns",
        spec=spec,
        router=f"unixsock-stream/{spec.run_dir}/{ROUTER_SOCKET}{shown}",
        prometheus_url=f"http://127.0.0.1:{spec.prometheus_port}" if spec.prometheus else "",
        ego_metrics_url=ego_metrics_url(spec),
        qod_url=f"http://127.0.0.1:{spec.qod_port}",
        llm_url=f"http://127.0.0.1:{spec.llm_port}" if spec.llm else "",
        console_url=f"http://localhost:{spec.console_port}" if spec.console else "",
        processes=marks,
    )


def _lines(path: Path, spec: SwarmSpec, follow: bool) -> Iterator[str]:
    if not path.exists():
        return
    with open(path, encoding="utf-8", errors="replace") as file:
        while True:
            ended = not follow or not (Path(spec.run_dir) / control.SOCKET).exists()
            part = ""
            while text := file.readline():
                part += text
                if part.endswith("\n"):
                    yield part[:-1]
                    part = ""
            if part:
                file.seek(file.tell() - len(part.encode()))
            if ended:
                return
            time.sleep(FOLLOW_S)
            if os.fstat(file.fileno()).st_size < file.tell():
                file.seek(0)  # It was full, and has been emptied.


RUNTIMES = (NetnsRuntime,)
