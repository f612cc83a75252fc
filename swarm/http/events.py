"""Server-sent events as an answer to an HTTP request."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Mapping

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

STALLED_S = 30.0
"""A client that takes no event for so long is left. Shorter than `UNTAKEN_S` of
`swarm.http.serving`, after which the socket goes, too."""


class EventStream(Response):
    """Sends events as they come, until they end, or the client leaves or takes none."""

    def __init__(
        self,
        events: AsyncGenerator[bytes],
        headers: Mapping[str, str] | None = None,
        *,
        stalled: Callable[[], None] = lambda: None,
    ) -> None:
        """`events` are asked for the next one when the last one is sent, and closed at the end.
        `stalled` is called for a client that is left because it takes none."""
        super().__init__(headers=headers, media_type="text/event-stream")
        self._events = events
        self._stalled = stalled
        # Without a length, so that the body is sent in chunks.
        self.raw_headers = [h for h in self.raw_headers if h[0] != b"content-length"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers one request. Raises what `events` raise."""
        pushing = asyncio.create_task(self._push(send))
        leaving = asyncio.create_task(_left(receive))
        try:
            await asyncio.wait({pushing, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (pushing, leaving):
                task.cancel()
            await asyncio.gather(pushing, leaving, return_exceptions=True)
        if not pushing.cancelled():
            pushing.result()

    async def _push(self, send: Send) -> None:
        start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
        body = {"type": "http.response.body"}
        try:
            await send(start)
            async for event in self._events:
                try:
                    async with asyncio.timeout(STALLED_S):
                        await send(body | {"body": event, "more_body": True})
                except TimeoutError:
                    self._stalled()
                    return
            await send(body | {"body": b"", "more_body": False})
        finally:
            await self._events.aclose()


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
