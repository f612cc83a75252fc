"""The OpenAI-compatible HTTP door, for clients that are no part of the swarm."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import re
import socket
from collections.abc import Generator

import uvicorn
from prometheus_client import CollectorRegistry

from llm_gateway.http_app import Completer, make_app
from swarm.errors import SettingError
from swarm.log import Logger

MAX_CONNECTIONS = 256
_BACKLOG = 128
# RFC 6750: what may stand behind "Bearer".
_TOKEN = re.compile(r"[A-Za-z0-9._~+/-]+=*")


class HttpDoor:
    """Answers on host and port, on the event loop that starts it; port 0 takes a free one.

    The socket is bound at once, so that a wrong address ends the process before it does anything.
    Raises SettingError.
    """

    def __init__(
        self,
        gateway: Completer,
        host: str,
        port: int,
        token: str,
        registry: CollectorRegistry,
        log: Logger,
    ) -> None:
        if token and not _TOKEN.fullmatch(token):
            # The value is a secret.
            raise SettingError(
                "COADAPT_LLM_HTTP_TOKEN is not valid; it must be letters, digits and . _ ~ + / -"
            )
        if not token and not _is_loopback(host):
            raise SettingError(
                f"COADAPT_LLM_HTTP_HOST = {host!r} can be reached from elsewhere, and "
                "COADAPT_LLM_HTTP_TOKEN is not set; set a token, or use 127.0.0.1"
            )
        self._socket = _bind(host, port)
        self.port = int(self._socket.getsockname()[1])
        self._log = log
        self._server = _Server(
            uvicorn.Config(
                make_app(gateway, token, registry, log),
                http="h11",
                ws="none",
                lifespan="off",
                log_config=None,
                access_log=False,
                server_header=False,
                proxy_headers=False,
                limit_concurrency=MAX_CONNECTIONS,
                timeout_graceful_shutdown=1,
            )
        )
        self._serving: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Begins to answer."""
        self._serving = asyncio.create_task(self._server.serve([self._socket]))
        self._log.info("llm_http_up", port=self.port)

    async def close(self) -> None:
        """Stops answering; requests under way get a moment. May be called again."""
        self._server.should_exit = True
        serving, self._serving = self._serving, None
        if serving is not None:
            await serving
        self._socket.close()


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Leaves signals to the process."""
        yield


def _is_loopback(host: str) -> bool:
    """Whether a host name or address cannot be reached from elsewhere."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _bind(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        bound = socket.create_server((host, port), family=family, backlog=_BACKLOG)
        # Connections inherit it. asyncio does not set it on them, and without it the second answer
        # on a connection waits 40 ms for the client to acknowledge its headers.
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return bound
    except (OSError, OverflowError) as error:
        raise SettingError(
            f"COADAPT_LLM_HTTP_PORT = {port} on COADAPT_LLM_HTTP_HOST = {host!r} cannot be bound: "
            f"{error}; choose a free port (0 takes any) and an address of this host"
        ) from error
