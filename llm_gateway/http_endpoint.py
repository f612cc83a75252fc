"""The OpenAI-compatible HTTP endpoint, for clients that are no part of the swarm."""

from __future__ import annotations

import asyncio
from collections.abc import Collection

from prometheus_client import CollectorRegistry

from llm_gateway.http_app import make_app
from llm_gateway.model import Completer
from llm_gateway.wish_reading import TrainedModel
from swarm.http.access import Access, check_token
from swarm.http.serving import HttpServer, bind, server_config
from swarm.log import Logger

MAX_CONNECTIONS = 256


class HttpEndpoint:
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
        *,
        names: Collection[str] = (),
        trained: TrainedModel | None = None,
    ) -> None:
        """`names`: see `Access`. `trained`: understands wishes; None: the gateway's model does."""
        check_token("COADAPT_LLM_HTTP_TOKEN", token)
        self._socket = bind("COADAPT_LLM_HTTP", host, port, token=bool(token))
        self.port = int(self._socket.getsockname()[1])
        self._log = log
        app = make_app(gateway, Access(host, token, names), registry, log, trained)
        self._server = HttpServer(server_config(app, connections=MAX_CONNECTIONS, grace_s=1))
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
