"""The one way out of the swarm's network: to the model server that `up` was given.

The gateway uses the server's own name, address and port, so that certificates and virtual hosts
are right; they lead to a port of this namespace, from there through a Unix socket to the host's
relay, and from that to the server.
"""

from __future__ import annotations

import asyncio
import ipaddress
from pathlib import Path

from deploy.netns import network, relay
from deploy.spec import SwarmSpec

SERVER_SOCKET = "llm-server.sock"
HOSTS = "hosts"
LOOPBACK = "127.0.0.1"


async def serve(spec: SwarmSpec) -> asyncio.Server | None:
    """Listens in this namespace in the model server's stead; None where there is no such server.

    Raises DeployError with the words of the command that failed, OSError for a port that cannot be
    listened on.
    """
    server = spec.llm_server()
    if server is None:
        return None
    host, port = server
    way = Path(spec.run_dir, SERVER_SOCKET)
    inwards = relay.forwarder(lambda: asyncio.open_unix_connection(way))
    return await asyncio.start_server(inwards, _stand_in(spec, host), port)


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
