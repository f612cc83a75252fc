"""Server-sent events: how an answer ends, and that what makes the events is closed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Any

import pytest

from swarm.http.events import EventStream

Send = Callable[[Any], Awaitable[None]]


class Events:
    """Events without end, or until `error`; `closed` once nobody takes them any more."""

    def __init__(self, error: Exception | None = None) -> None:
        self.closed = False
        self._error = error

    async def make(self) -> AsyncGenerator[bytes]:
        try:
            while True:
                yield b"data: 1\n\n"
                if self._error is not None:
                    raise self._error
                await asyncio.sleep(0)
        finally:
            self.closed = True


def answer(stream: EventStream, send: Send, left: asyncio.Event | None = None) -> None:
    """Answers one client, who leaves when that is set."""

    async def receive() -> dict[str, str]:
        await (left or asyncio.Event()).wait()
        return {"type": "http.disconnect"}

    async def story() -> None:
        async with asyncio.timeout(10):
            await stream({"type": "http"}, receive, send)
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(story())


def test_a_client_that_leaves_ends_the_events() -> None:
    events, left, sent = Events(), asyncio.Event(), []

    async def send(message: Any) -> None:
        sent.append(message)
        if len(sent) == 5:
            left.set()

    answer(EventStream(events.make()), send, left)
    assert events.closed
    names = [name for name, _ in sent[0]["headers"]]
    assert b"content-length" not in names
    assert all(message["more_body"] for message in sent[1:])


def test_a_client_that_takes_nothing_is_left_and_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarm.http.events.STALLED_S", 0.05)
    events, told = Events(), []

    async def send(message: Any) -> None:
        if message["type"] == "http.response.body":
            await asyncio.Event().wait()

    answer(EventStream(events.make(), stalled=lambda: told.append(True)), send)
    assert events.closed
    assert told == [True]


def test_what_fails_in_the_events_is_raised() -> None:
    events = Events(ValueError("broken"))

    async def send(message: Any) -> None:
        pass

    with pytest.raises(ValueError, match="broken"):
        answer(EventStream(events.make()), send)
    assert events.closed
