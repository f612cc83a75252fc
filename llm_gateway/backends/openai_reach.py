"""Whether a model server can be reached, in words, and told once each way."""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

import aiohttp

from swarm.log import Logger

PROBE_S = 3.0
"""How often a server that could not be reached is tried, whether or not anybody asks."""
DOUBT_S = 0.5
"""After how long a server that broke a connection off is tried."""


class Reach:
    """Used on one event loop. `trouble` says why the server cannot be reached; "" where it can."""

    def __init__(self, url: str, probe: Callable[[], Awaitable[object]], log: Logger) -> None:
        """`probe` tries to reach it, and whatever comes of that tells `lost` or `found`."""
        self.trouble = ""
        self._url = url
        self._probe = probe
        self._log = log
        self._trying: asyncio.Task[None] | None = None
        self._closed = False

    def lost(self, why: str) -> None:
        """It could not be reached."""
        if not self.trouble:
            self._log.warning("llm_server_unreachable", url=self._url, error=why)
        self.trouble = why
        self._begin_trying(PROBE_S)

    def broke_off(self, why: str) -> None:
        """It ended a connection without an answer: that may happen once to one that is there."""
        if self._is_trying():
            self.lost(why)
        else:
            self._begin_trying(DOUBT_S)

    def found(self) -> None:
        """It has answered, whatever it said."""
        if self.trouble:
            self.trouble = ""
            self._log.info("llm_server_back", url=self._url)

    async def close(self) -> None:
        """Tries no more, whatever is told afterwards."""
        self._closed = True
        trying, self._trying = self._trying, None
        if trying is not None:
            trying.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await trying

    def _is_trying(self) -> bool:
        return self._trying is not None and not self._trying.done()

    def _begin_trying(self, first_s: float) -> None:
        if not self._closed and not self._is_trying():
            self._trying = asyncio.create_task(self._try(first_s))

    async def _try(self, first_s: float) -> None:
        await asyncio.sleep(first_s)
        await self._probe()
        while self.trouble:
            await asyncio.sleep(PROBE_S)
            await self._probe()


def why_lost(error: aiohttp.ClientConnectionError, url: str, said: str) -> str:
    """What stands between us and a server; `said` are the error's own words."""
    parts = urlsplit(url)
    port = parts.port or (443 if parts.scheme == "https" else 80)
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    there = f"{host}:{port}"
    if isinstance(error, aiohttp.ClientConnectorDNSError):
        return f"no host is called {parts.hostname}"
    if isinstance(error, aiohttp.ClientSSLError):
        return f"no TLS with {there}: {said}"
    if isinstance(error, aiohttp.ServerTimeoutError):
        return f"no answer from {there}"
    if isinstance(error, OSError) and error.errno == errno.ECONNREFUSED:
        return f"refused by {there}"
    return f"{there}: {said}"
