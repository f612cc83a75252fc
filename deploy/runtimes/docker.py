"""The Docker runtime: one container a process, started by compose."""

from __future__ import annotations

import contextlib
import datetime
import getpass
import ipaddress
import os
import socket
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from deploy import environments, paths
from deploy import state as record
from deploy.docker import compose, grafana
from deploy.docker.image import ensure_image
from deploy.docker.llm_image import ensure_llm_image
from deploy.ports import check_free
from deploy.progress import say
from deploy.runtime import ProcessState, ProcessStatus
from deploy.services import ego_metrics_url, services
from deploy.spec import EMBEDDED, SwarmSpec, run_dir_of
from swarm.errors import DeployError
from swarm.trust.roles import operator_of

STOP_S = 5
_UNIX = "unix://"
_HOST = f"{_UNIX}/var/run/docker.sock"
"""Where the engine answers unless DOCKER_HOST says otherwise."""
IFB_PREFIX = "ifb-"
"""How the names of the controller's devices that queue begin (`drivers/ifbs.py`)."""
GOING_ALREADY = 409
"""The engine's answer while a container is being removed."""


class DockerRuntime:
    """Runs a swarm's processes as containers of one compose project."""

    name = "docker"

    def available(self) -> str | None:
        """None when an engine answers and compose is there, else what is missing."""
        try:
            _engine().ping()
        except DeployError as error:
            return str(error)
        if compose.compose_command() is None:
            return "compose is missing: install docker-compose or Docker's compose plugin"
        return None

    def up(self, spec: SwarmSpec) -> bool:
        """Starts the containers; see `base.Runtime.up`."""
        with record.exclusive(), _faults():
            running = record.read_state(spec.swarm)
            if running is not None and self._containers(spec.swarm):
                record.check_same(running, spec)
                return False
            self._clear(spec.swarm)
            check_free(spec)
            self._start(spec)
            return True

    def _start(self, spec: SwarmSpec) -> None:
        image = ensure_image(say)
        llm_image = ensure_llm_image(image, say) if spec.llm == EMBEDDED else image
        if spec.grafana:
            grafana.ensure_image(say)
        try:
            self._start_from(image, llm_image, spec)
        except BaseException:
            self._clear(spec.swarm)
            raise

    def _start_from(self, image: str, llm_image: str, spec: SwarmSpec) -> None:
        run_dir = record.make_run_dir(spec)
        for folder in paths.FOLDERS:
            Path(spec.var_dir, folder).mkdir(parents=True, exist_ok=True)
        router = f"tcp/127.0.0.1:{spec.router_port}"
        if spec.secure:
            from deploy.trust.prepare import prepare

            operator = operator_of(getpass.getuser())
            prepare(spec, compose.place_of(spec), operator)
            own = paths.identity_path(spec.var_dir, operator.common_name)
            router = environments.router_address(spec, "127.0.0.1", own)
        (run_dir / "prometheus.yml").write_text(compose.prometheus_file(spec))
        if spec.grafana:
            grafana.write_password(run_dir)
        file = run_dir / "compose.yml"
        file.write_text(compose.compose_file(spec, image, llm_image, _gateway()))
        record.write_state(
            record.State(
                runtime="docker",
                spec=spec,
                router=router,
                prometheus_url=(
                    f"http://127.0.0.1:{spec.prometheus_port}" if spec.prometheus else ""
                ),
                ego_metrics_url=ego_metrics_url(spec),
                qod_url=f"http://127.0.0.1:{spec.qod_port}",
                llm_url=f"http://127.0.0.1:{spec.llm_port}" if spec.llm else "",
                grafana_url=f"http://127.0.0.1:{spec.grafana_port}" if spec.grafana else "",
                console_url=f"http://localhost:{spec.console_port}" if spec.console else "",
            )
        )
        compose.start(spec, file)

    def down(self, swarm: str) -> bool:
        """Removes every container and network that carries the swarm's label, and its record."""
        with record.exclusive(), _faults():
            return self._clear(swarm)

    def _clear(self, swarm: str) -> bool:
        import docker.errors

        found = False
        try:
            engine = _engine()
        except DeployError:
            if run_dir_of(swarm).exists():
                raise
            return False
        containers = self._containers(swarm)
        _check_own(swarm, containers)
        own = [c for c in containers if c.labels[compose.SERVICE_LABEL] != "grafana"]
        if containers:
            found = True
            with ThreadPoolExecutor(len(containers)) as pool:
                list(pool.map(_remove, containers))
        for network in engine.networks.list(filters={"label": f"{compose.LABEL}={swarm}"}):
            with contextlib.suppress(docker.errors.NotFound):
                network.remove()
            found = True
        # Only now: what queued for the swarm's bridge outlives it.
        if own:
            _sweep(engine, own[0].attrs["Image"])
        return record.remove_run_dir(swarm) or found

    def status(self, swarm: str) -> tuple[ProcessStatus, ...]:
        """The containers' states in the order of the services."""
        state = record.need_state(swarm)
        with _faults():
            by_name = {c.labels[compose.SERVICE_LABEL]: c for c in self._containers(swarm)}
        members = services(state.spec, compose.place_of(state.spec))
        return tuple(_status(member.name, by_name.get(member.name)) for member in members)

    def logs(self, swarm: str, service: str, follow: bool) -> Iterator[str]:
        """The lines of one container's standard output and error."""
        container = self._container(swarm, service)
        rest = b""
        for chunk in container.logs(stream=True, follow=follow):
            *lines, rest = (rest + chunk).split(b"\n")
            yield from (line.decode(errors="replace") for line in lines)
        if rest:
            yield rest.decode(errors="replace")

    def _container(self, swarm: str, service: str) -> Any:
        by_name = {c.labels[compose.SERVICE_LABEL]: c for c in self._containers(swarm)}
        if service not in by_name:
            raise DeployError(f"no process {service!r}; there are {', '.join(sorted(by_name))}")
        return by_name[service]

    def _containers(self, swarm: str) -> list[Any]:
        label = f"{compose.LABEL}={swarm}"
        found: list[Any] = _engine().containers.list(all=True, filters={"label": label})
        return found


@contextlib.contextmanager
def _faults() -> Iterator[None]:
    """Turns what Docker's client, its connection and its programs raise into DeployError."""
    import docker.errors

    try:
        yield
    except subprocess.TimeoutExpired as error:
        words = " ".join(map(str, error.cmd))
        raise DeployError(f"{words} did not end within {error.timeout:.0f} s") from error
    # What its client's connection raises is an OSError.
    except (docker.errors.DockerException, OSError) as error:
        raise DeployError(f"Docker cannot do what it should: {error}") from error


def _engine() -> Any:
    """A client of the local engine. Raises DeployError when none answers."""
    import docker
    import docker.errors

    host = os.environ.get("DOCKER_HOST") or _HOST
    if host.startswith(_UNIX) and not Path(host.removeprefix(_UNIX)).exists():
        # The client would leave a socket open.
        raise DeployError(f"no Docker engine answers: there is no {host.removeprefix(_UNIX)}")
    try:
        engine = docker.from_env(timeout=60)
        engine.ping()
    except (docker.errors.DockerException, OSError) as error:
        raise DeployError(f"no Docker engine answers: {error}") from error
    return engine


def _gateway() -> str:
    """The host's address on Docker's bridge, at which containers reach the host."""
    return gateway_of(_engine().networks.get("bridge").attrs["IPAM"]["Config"])


def gateway_of(config: Sequence[Mapping[str, str]]) -> str:
    """The gateway that a network's address configuration names, else takes.

    An engine that was started for the first time names none (seen with 20.10); it takes the first
    address of the subnet. Raises DeployError where there is no subnet, either.
    """
    for entry in config:
        if entry.get("Gateway"):
            return entry["Gateway"]
    for entry in config:
        if entry.get("Subnet"):
            return str(next(ipaddress.ip_network(entry["Subnet"]).hosts()))
    raise DeployError("Docker's network `bridge` has no gateway, so nothing reaches the host")


def _check_own(swarm: str, containers: Sequence[Any]) -> None:
    """Raises DeployError where somebody else's swarm has the same name in this engine."""
    own = str(run_dir_of(swarm))
    for container in containers:
        theirs = container.labels.get(compose.RUN_DIR_LABEL, own)
        if theirs != own:
            raise DeployError(
                f"another swarm {swarm!r} runs in this Docker engine, started from run directory "
                f"{theirs} (here: {own}); give this one another name (SWARM=, --swarm)"
            )


def _sweep(engine: Any, image: str) -> None:
    """Removes what a controller that was killed left on the host. It takes a container as the
    controller's own: whoever may use the engine need not be root here."""
    names = {name for _, name in socket.if_nameindex()}
    links = {name.removeprefix(IFB_PREFIX) for name in names if name.startswith(IFB_PREFIX)}
    if not links - names:
        return
    host = {k: v for k, v in compose.CONTROLLER.items() if k != "cap_add"}
    argv = ["python3", "-m", "network_controller.sweep"]
    engine.containers.run(image, argv, remove=True, cap_add=["NET_ADMIN"], **host)


def _remove(container: Any) -> None:
    import docker.errors

    # Another `down`, or the engine itself, may remove it at the same moment.
    try:
        container.stop(timeout=STOP_S)
        container.remove(force=True, v=True)
    except docker.errors.NotFound:
        return
    except docker.errors.APIError as error:
        if error.status_code != GOING_ALREADY:
            raise


def _status(service: str, container: Any | None) -> ProcessStatus:
    if container is None:
        return ProcessStatus(service, "stopped", 0, 0.0, "its container is gone")
    facts = container.attrs
    state = facts["State"]
    restarts = int(facts.get("RestartCount", 0))
    if state["Status"] == "running":
        begun = datetime.datetime.fromisoformat(state["StartedAt"][:19] + "+00:00")
        uptime = (datetime.datetime.now(datetime.UTC) - begun).total_seconds()
        return ProcessStatus(service, "running", restarts, max(0.0, uptime))
    detail = f"exit code {state.get('ExitCode')} {state.get('Error', '')}".strip()
    kind: ProcessState = "restarting" if state["Status"] == "restarting" else "stopped"
    return ProcessStatus(service, kind, restarts, 0.0, detail)


RUNTIMES = (DockerRuntime,)
