"""The API as a server with a thread of its own."""

from __future__ import annotations

import contextlib
import os
import socket as sockets
import stat
import threading
from collections.abc import Collection
from pathlib import Path

import uvicorn
from prometheus_client import CollectorRegistry

from network_controller.qod.app import make_app
from network_controller.qod.destinations import Destinations
from network_controller.qod.metrics import QodMetrics
from network_controller.qod.network import Network
from network_controller.qod.service import Service
from swarm.errors import SettingError
from swarm.http.access import Access, check_token
from swarm.http.serving import bind, server_config
from swarm.log import Logger

MAX_CONNECTIONS = 100
_BACKLOG = 64


class Server:
    """Answers on host and port, or on a Unix socket where one is named; port 0 takes a free one.

    The socket is bound at once, so that a wrong address ends the process before it does anything.
    Raises SettingError.
    """

    def __init__(
        self,
        network: Network,
        host: str,
        port: int,
        token: str,
        registry: CollectorRegistry,
        log: Logger,
        *,
        socket: str = "",
        names: Collection[str] = (),
        sinks: Collection[str] = (),
    ) -> None:
        """`names`: see `Access`; `sinks`: see `Destinations`."""
        check_token("COADAPT_QOD_TOKEN", token)
        destinations = Destinations(sinks)
        access = Access("localhost" if socket else host, token, names)
        self._path = Path(socket) if socket else None
        if self._path is not None:
            self._socket = _bind_path(self._path)
        else:
            self._socket = bind("COADAPT_QOD", host, port, token=bool(token))
        self._log = log
        metrics = QodMetrics(registry)
        self._service = Service(network, destinations, metrics, log)
        app = make_app(self._service, access, metrics, log)
        config = server_config(app, connections=MAX_CONNECTIONS, grace_s=2)
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="qod", daemon=True)

    @property
    def port(self) -> int:
        """The port that is bound; 0 on a Unix socket."""
        return 0 if self._path else int(self._socket.getsockname()[1])

    def start(self) -> None:
        """Begins to answer."""
        self._service.start()
        self._thread.start()
        where = str(self._path) if self._path else f"port {self.port}"
        self._log.info("qod_up", where=where)

    def lost(self, robot: str) -> None:
        """Ends the sessions on a robot's link, which is gone or not shaped any more.

        Call it without the network's own lock: it calls the network.
        """
        self._service.book.lost(robot)

    def close(self) -> None:
        """Stops answering, ends all sessions and tells their sinks; may be called again."""
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join()
        self._service.close()
        self._socket.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def _run(self) -> None:
        try:
            self._server.run(sockets=[self._socket])
        except Exception:
            self._log.error("qod_down", exc_info=True)


def _bind_path(path: Path) -> sockets.socket:
    """A Unix socket that only this user can reach."""
    bound = sockets.socket(sockets.AF_UNIX, sockets.SOCK_STREAM)
    try:
        _remove_stale(path)
        bound.bind(str(path))
        # Before it listens nobody can connect, so it is never open to others.
        os.chmod(path, 0o600)
        bound.listen(_BACKLOG)
    except OSError as error:
        bound.close()
        raise SettingError(
            f"COADAPT_QOD_SOCKET = {str(path)!r} cannot be bound: {error}; it must be a path of "
            "at most 107 bytes in a directory that exists, where nothing else answers"
        ) from error
    return bound


def _remove_stale(path: Path) -> None:
    """Removes what a killed controller left; whatever else is there stays."""
    if not path.exists() or not stat.S_ISSOCK(path.stat().st_mode):
        return
    with contextlib.closing(sockets.socket(sockets.AF_UNIX, sockets.SOCK_STREAM)) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
