"""The one way out of the swarm's network: to the model server that `up` was given.

The gateway uses the server's own name, address and port, so that certificates and virtual hosts
are right; they lead to a port of this namespace, from there through a Unix socket to the host's
relay, and from that to the server. While the server cannot be reached, that port does not listen:
the gateway is refused as it would be outside.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
from pathlib import Path

from deploy.netns import network, relay
from deploy.spec import SwarmSpec

SERVER_SOCKET = "llm-server.sock"
HOSTS = "hosts"
LOOPBACK = "127.0.0.1"
RETRY_S = 1.0
"""How often a server that is away is tried."""
RELAY_S = 5.0
"""How long the host's relay, which starts after the swarm, is waited for."""


class StandIn:
    """Stands for the model server in this namespace, while it can be reached. `way` leads to the
    host's relay."""

    def __init__(self, way: Path, host: str, port: int) -> None:
        self._way = way
        self._host = host
        self._port = port
        self._server: asyncio.Server | None = None
        self._retrying: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Listens. Raises OSError for a port that cannot be listened on."""
        inwards = relay.forwarder(self._reach_or_refuse)
        self._server = await asyncio.start_server(inwards, self._host, self._port)

    def close(self) -> None:
        """Listens no more."""
        if self._retrying is not None:
            self._retrying.cancel()
        if self._server is not None:
            self._server.close()

    async def _reach_or_refuse(self) -> relay.Streams:
        try:
            return await self._reach()
        except OSError:
            if self._server is not None:
                self._server.close()
                self._server = None
                self._retrying = asyncio.create_task(self._retry())
            raise

    async def _retry(self) -> None:
        """Listens again once the server is there."""
        while self._server is None:
            await asyncio.sleep(RETRY_S)
            with contextlib.suppress(OSError):
                _, writer = await self._reach()
                writer.close()
                await self.open()

    async def _reach(self) -> relay.Streams:
        """A connection to the server. Raises OSError where there is none."""
        async with asyncio.timeout(RELAY_S):
            while not self._way.exists():
                await asyncio.sleep(0.05)
        reader, writer = await asyncio.open_unix_connection(self._way)
        if await reader.read(1) != relay.REACHED:
            writer.close()
            raise ConnectionRefusedError(f"{self._host}:{self._port} cannot be reached")
        return reader, writer


async def serve(spec: SwarmSpec) -> StandIn | None:
    """Listens in this namespace in the model server's stead; None where there is no such server.

    Raises DeployError with the words of the command that failed, OSError for a port that cannot be
    listened on.
    """
    server = spec.llm_server()
    if server is None:
        return None
    host, port = server
    made = StandIn(Path(spec.run_dir, SERVER_SOCKET), _stand_in(spec, host), port)
    await made.open()
    return made


def _stand_in(spec: SwarmSpec, host: str) -> str:
    """The address of this namespace that a host name or address leads to from now on."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        hosts = Path(spec.run_dir, HOSTS)
        hosts.write_text(f"{LOOPBACK} {host}\n{Path('/etc/hosts').read_text()}")
        network.run("mount", "--bind", str(hosts), "/etc/hosts")
        return LOOPBACK
    if not address.is_loopback:
        network.run("ip", "addr", "add", str(address), "dev", "lo")
    return host
