"""PID 1 of a swarm's namespaces: `python -m deploy.netns.supervisor`.

`deploy.netns.launch` starts it. It reads the specification (JSON) from standard input, builds the
network, starts the processes, writes one line (`control.Reply`) to standard output, and then
serves the control socket until it is told to stop. When it ends, by whatever cause, the kernel
ends every process of its PID namespace and removes the network and the mounts with it.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from deploy.dashboards import ALERTS
from deploy.environments import EGO_METRICS_PORT
from deploy.netns import control, network, outside, relay
from deploy.netns.children import Children
from deploy.paths import TARGETS, authority_path
from deploy.roster import INFRA, PROMETHEUS_PORT, Place
from deploy.scraping import prometheus_config
from deploy.services import services
from deploy.spec import SwarmSpec
from swarm.errors import CoAdaptError
from swarm.log import make_logger
from swarm.traffic import TrafficClass

ROUTER_SOCKET = "router.sock"
PROMETHEUS_SOCKET = "prometheus.sock"
EGO_METRICS_SOCKET = "ego-metrics.sock"
QOD_SOCKET = "qod.sock"
LLM_HTTP_SOCKET = "llm.sock"
CONSOLE_SOCKET = "console.sock"
CLASS_SOCKETS: Mapping[TrafficClass, str] = {
    cls: f"router-{number}.sock" for number, cls in enumerate(TrafficClass, 1)
}
"""Of the router's ports, for who reaches it from outside."""
PROMETHEUS_FILE = "prometheus.yml"


def place_of(spec: SwarmSpec) -> Place:
    """Addresses and paths of the processes of a swarm in network namespaces."""
    return Place(
        listen_host=network.BRIDGE_ADDRESS,
        router_host=network.BRIDGE_ADDRESS,
        unix_socket=f"{spec.run_dir}/{ROUTER_SOCKET}",
        var_dir=spec.var_dir,
        driver="netns",
        qod_socket=f"{spec.run_dir}/{QOD_SOCKET}",
        prometheus_config=f"{spec.run_dir}/{PROMETHEUS_FILE}",
        targets=f"{spec.var_dir}/{TARGETS}/joined.json",
        data=spec.data,
        cache=spec.cache,
        python=sys.executable,
    )


class Supervisor:
    """Runs one swarm's processes and answers on its control socket."""

    def __init__(self, spec: SwarmSpec) -> None:
        self._spec = spec
        self._run_dir = Path(spec.run_dir)
        self._log = make_logger("supervisor", swarm=spec.swarm)
        self._members = services(spec, place_of(spec))
        self._children = Children(self._members, Path(spec.var_dir) / "logs", self._log)
        self._stop = asyncio.Event()

    async def run(self) -> None:
        """Starts all, says so on standard output, and waits for `stop`, SIGTERM or SIGINT."""
        network.build(self._spec)
        (self._run_dir / PROMETHEUS_FILE).write_text(
            prometheus_config(
                self._members,
                lambda s: network.address(self._spec, s.host),
                str(ALERTS),
                place_of(self._spec).targets,
                ca=authority_path(self._spec.var_dir) if self._spec.secure else "",
                tls=self._spec.metrics_tls,
            )
        )
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop.set)
        servers = [
            await asyncio.start_unix_server(self._serve, path=self._run_dir / control.SOCKET),
            await relay.serve_unix(
                self._run_dir / EGO_METRICS_SOCKET,
                network.address(self._spec, self._spec.ego),
                EGO_METRICS_PORT,
            ),
        ]
        if self._spec.prometheus:
            servers.append(
                await relay.serve_unix(
                    self._run_dir / PROMETHEUS_SOCKET,
                    network.address(self._spec, INFRA),
                    PROMETHEUS_PORT,
                )
            )
        if self._spec.llm:
            servers.append(
                await relay.serve_unix(
                    self._run_dir / LLM_HTTP_SOCKET, outside.LOOPBACK, self._spec.llm_port
                )
            )
        if self._spec.console:
            servers.append(
                await relay.serve_unix(
                    self._run_dir / CONSOLE_SOCKET, outside.LOOPBACK, self._spec.console_port
                )
            )
        if self._spec.listen:
            for cls, path in CLASS_SOCKETS.items():
                port = self._spec.router_port + cls.value.port_offset
                servers.append(
                    await relay.serve_unix(self._run_dir / path, network.BRIDGE_ADDRESS, port)
                )
        way_out = await outside.serve(self._spec)
        self._children.start()
        answer(control.Reply())
        self._log.info("swarm_up", processes=len(self._members))
        await self._stop.wait()
        await self._children.stop()
        if way_out is not None:
            way_out.close()
        self._log.info("swarm_down")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await reader.readline():
                writer.write(msgspec.json.encode(self._reply(line)) + b"\n")
                await writer.drain()
        except (OSError, ValueError):
            pass  # The tool left, or its line is endless: only its own connection ends.
        finally:
            writer.close()

    def _reply(self, line: bytes) -> control.Reply:
        try:
            request = msgspec.json.decode(line, type=control.Request)
        except msgspec.DecodeError as error:
            return control.Reply(error=str(error))
        try:
            if request.command == "stop":
                self._stop.set()
            elif request.command == "kill":
                self._children.kill(request.service, request.signal)
        except KeyError:
            names = ", ".join(service.name for service in self._members)
            return control.Reply(error=f"no such process; there are {names}")
        except OSError as error:
            return control.Reply(error=f"it does not run or cannot be signalled: {error}")
        return control.Reply(services=self._children.status())


def answer(reply: control.Reply) -> None:
    """Tells `up`, which waits at the other end of standard output, and closes it."""
    os.write(1, msgspec.json.encode(reply) + b"\n")
    # Standard error is the supervisor's log from here on for both.
    os.dup2(2, 1)


async def supervise(spec: SwarmSpec) -> None:
    """Runs one swarm until it is told to stop."""
    await Supervisor(spec).run()


def main() -> int:
    """Runs one swarm; 1 when it could not be started."""
    text = sys.stdin.buffer.read()
    if not text:
        return 1  # `up` was ended before it could say what to start.
    try:
        asyncio.run(supervise(msgspec.json.decode(text, type=SwarmSpec)))
    except (CoAdaptError, OSError) as error:
        answer(control.Reply(error=str(error)))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
