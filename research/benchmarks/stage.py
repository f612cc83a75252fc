"""Links without a swarm, to measure shaping on: a few hosts on one bridge, and a real driver."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from deploy.docker.image import ensure_image
from deploy.netns import network
from deploy.progress import say
from deploy.spec import factory_robots, make_spec
from network_controller.drivers.base import Driver
from network_controller.drivers.docker import LABEL, SERVICE_LABEL, DockerDriver
from network_controller.drivers.netns import NetnsDriver
from research.benchmarks.ending import signals_raise

FIRST_PORT = 5100
SWARM = "coadapt-bench"
SETTLE_S = 0.5


@dataclass(slots=True)
class Stage:
    """Hosts R1 to Rn, a driver for their links, and programs that run at them."""

    driver: Driver
    prefixes: Mapping[str, list[str]]
    """What to put before `python ...` so that it runs at a host."""
    python: str
    _port: int = FIRST_PORT

    def start(self, host: str, *argv: str) -> subprocess.Popen[str]:
        """Runs `python -m argv` at a host."""
        command = [*self.prefixes[host], self.python, "-m", *argv]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def flow(self, source: str, target: str, seconds: float, **options: Any) -> Flow:
        """A flow between two hosts that runs already; options are those of `flow.py`."""
        self._port += 1
        common = ["--port", str(self._port), "--seconds", str(seconds)]
        receiver = self.start(target, "research.benchmarks.flow", "receive", *common)
        time.sleep(SETTLE_S)
        address = self.driver.robots()[target]
        words = [w for k, v in options.items() for w in (f"--{k.replace('_', '-')}", str(v))]
        sender = self.start(
            source, "research.benchmarks.flow", "send", *common, "--to", address, *words
        )
        return Flow(receiver, sender)


@dataclass(frozen=True, slots=True)
class Flow:
    """A flow under way."""

    receiver: subprocess.Popen[str]
    sender: subprocess.Popen[str]

    def counts(self) -> dict[str, Any]:
        """When its first byte came, and bytes by second, once it has ended."""
        out, _ = self.receiver.communicate()
        self.sender.communicate()
        result: dict[str, Any] = json.loads(out)
        return result


@contextmanager
def netns_stage(hosts: int) -> Iterator[Stage]:
    """Hosts in namespaces of this process's own network; see `inside`."""
    spec = make_spec(swarm="bench", robots=factory_robots(hosts))
    network.build(spec)
    prefixes = {robot: list(network.enter(robot)) for robot in spec.robots}
    yield Stage(NetnsDriver(spec.swarm), prefixes | {"infra": []}, sys.executable)


@contextmanager
def docker_stage(hosts: int) -> Iterator[Stage]:
    """Hosts in containers of the project's image; needs root for the host's ends of their links."""
    import docker

    engine = docker.from_env()
    image = ensure_image(say)
    with signals_raise(), ExitStack() as stack:
        net = engine.networks.create(SWARM, labels={LABEL: SWARM})
        stack.callback(net.remove)
        prefixes = {}
        for robot in factory_robots(hosts):
            container = engine.containers.run(
                image,
                ["sleep", "3600"],
                detach=True,
                init=True,
                network=SWARM,
                labels={LABEL: SWARM, SERVICE_LABEL: f"robot-{robot}"},
            )
            stack.callback(container.remove, force=True)
            prefixes[robot] = ["docker", "exec", container.id]
        driver = DockerDriver(SWARM)
        stack.callback(driver.close)
        yield Stage(driver, prefixes, "python3")


def inside(module: str, *arguments: str) -> Any:
    """What `python -m module arguments` prints (JSON) in new network and mount namespaces."""
    return inside_together(module, [arguments])[0]


def inside_together(module: str, jobs: Sequence[Sequence[str]]) -> list[Any]:
    """The same of several lists of arguments, all running at once, each in namespaces of its own.

    Raises CalledProcessError when one fails; nothing of the others is left then.
    """
    unshare = (
        *("unshare", "--user", "--map-root-user", "--net", "--mount", "--pid", "--fork"),
        *("--kill-child", "--mount-proc", sys.executable, "-m", module),
    )
    with signals_raise(), ExitStack() as stack:
        started = []
        for arguments in jobs:
            process = subprocess.Popen((*unshare, *arguments), stdout=subprocess.PIPE, text=True)
            stack.callback(process.wait)
            # It takes its child with it, and that everything that is in there.
            stack.callback(process.kill)
            started.append(process)
        printed = []
        for process in started:
            out, _ = process.communicate()
            if process.returncode:
                raise subprocess.CalledProcessError(process.returncode, process.args)
            printed.append(json.loads(out.splitlines()[-1]))
    return printed
