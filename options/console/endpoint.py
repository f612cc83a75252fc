"""The socket that the console answers on."""

from __future__ import annotations

import socket
from typing import Any

from options.console.hub import MAX_VIEWERS
from options.console.settings import ConsoleSettings
from swarm.http.access import check_token
from swarm.http.serving import HttpServer, bind, server_config

MAX_CONNECTIONS = 4 * MAX_VIEWERS
SEND_BUFFER = 64 * 1024
"""Bytes on the way to a viewer are states that cannot be replaced by newer ones any more."""


class Endpoint:
    """Answers on host and port; the socket is bound at once. Raises SettingError."""

    def __init__(self, settings: ConsoleSettings) -> None:
        check_token("COADAPT_CONSOLE_TOKEN", settings.console_token)
        self._socket = bind(
            "COADAPT_CONSOLE",
            settings.console_host,
            settings.console_port,
            token=bool(settings.console_token),
        )
        # Connections inherit it.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self.port = int(self._socket.getsockname()[1])
        self._server: HttpServer | None = None

    async def serve(self, app: Any) -> None:
        """Answers until `stop` is called."""
        config = server_config(app, connections=MAX_CONNECTIONS, grace_s=1)
        self._server = HttpServer(config)
        await self._server.serve([self._socket])

    def stop(self) -> None:
        """Lets `serve` return; requests under way get a moment."""
        if self._server is not None:
            self._server.should_exit = True

    def close(self) -> None:
        """Lets go of the socket."""
        self._socket.close()
