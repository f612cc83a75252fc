"""A model server on the loopback that does what a test tells it, request by request."""

from __future__ import annotations

import asyncio
import json
import queue
import socket
import struct
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

WAIT_S = 20.0


class Request(NamedTuple):
    method: str
    path: str
    headers: dict[str, str]
    body: Any


Behaviour = Callable[[asyncio.StreamReader, asyncio.StreamWriter, Request], Awaitable[None]]


class ModelServer:
    """Use `serving_model`. Chat completions take the next behaviour of `plan`, then `otherwise`."""

    def __init__(self) -> None:
        self.plan: deque[Behaviour] = deque()
        self.otherwise: Behaviour = says("{}")
        self.models: list[str] = ["test-model"]
        self.port = 0
        self.asked: queue.Queue[Request] = queue.Queue()
        """Chat completions as they arrived."""
        self.left: queue.Queue[Request] = queue.Queue()
        """Those whose client went away before the answer."""
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def next(self) -> Request:
        return self.asked.get(timeout=WAIT_S)

    def next_left(self) -> Request:
        return self.left.get(timeout=WAIT_S)

    def start(self) -> None:
        """On the port that it had before, if it had one."""
        self._thread.start()
        assert self._ready.wait(WAIT_S)

    def stop(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(WAIT_S)

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._client, "127.0.0.1", self.port)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._end.wait()
        # Connections end with their tasks, when the loop does.
        server.close()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # A client may go away at any time, and the server be stopped.
        with suppress(ConnectionError, asyncio.IncompleteReadError, asyncio.CancelledError):
            while True:
                await self._answer(reader, writer)
        writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
        method, path, _ = head[0].split(" ")
        pairs = (line.split(": ", 1) for line in head[1:] if line)
        headers = {name.lower(): value for name, value in pairs}
        raw = await reader.readexactly(int(headers.get("content-length", 0)))
        request = Request(method, path, headers, json.loads(raw) if raw else None)
        if path.endswith("/models"):
            listed = {"object": "list", "data": [{"id": name} for name in self.models]}
            await status(200, json.dumps(listed))(reader, writer, request)
            return
        self.asked.put(request)
        behaviour = self.plan.popleft() if self.plan else self.otherwise
        work = asyncio.ensure_future(behaviour(reader, writer, request))
        gone = asyncio.ensure_future(reader.read(1))
        try:
            await asyncio.wait({work, gone}, return_when=asyncio.FIRST_COMPLETED)
            if not work.done():
                self.left.put(request)
                raise ConnectionResetError
            await work
        finally:
            for task in (work, gone):
                task.cancel()
                with suppress(asyncio.CancelledError, ConnectionError):
                    await task


def completion(text: Any, *, finish: str = "stop", **usage: Any) -> dict[str, Any]:
    """OpenAI's answer with this text."""
    message = {"role": "assistant", "content": text}
    choice = {"index": 0, "message": message, "finish_reason": finish}
    counts = usage or {"prompt_tokens": 100, "completion_tokens": 7, "total_tokens": 107}
    return {"id": "x", "object": "chat.completion", "choices": [choice], "usage": counts}


def says(text: Any, *, finish: str = "stop", **usage: Any) -> Behaviour:
    return status(200, json.dumps(completion(text, finish=finish, **usage)))


def streams(
    *words: str, go: threading.Event | None = None, finish: str | None = "stop"
) -> Behaviour:
    """Words as server-sent events; all but the first wait for `go`. Without `finish` it breaks off
    behind the last one."""

    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        def send(data: str) -> None:
            raw = f"data: {data}\n\n".encode()
            writer.write(f"{len(raw):x}\r\n".encode() + raw + b"\r\n")

        def chunk(delta: dict[str, str], end: str | None = None) -> None:
            send(json.dumps({"choices": [{"index": 0, "delta": delta, "finish_reason": end}]}))

        assert request.body["stream"]
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream; charset=utf-8\r\n")
        writer.write(b"Transfer-Encoding: chunked\r\n\r\n")
        chunk({"role": "assistant", "content": ""})
        for number, word in enumerate(words):
            if number == 1 and go is not None:
                await asyncio.to_thread(go.wait, WAIT_S)
            chunk({"content": word})
            await writer.drain()
        if finish:
            chunk({}, finish)
            usage = {"prompt_tokens": 11, "completion_tokens": len(words)}
            send(json.dumps({"choices": [], "usage": usage}))
            send("[DONE]")
        writer.write(b"0\r\n\r\n")
        await writer.drain()

    return behave


def status(code: int, body: str, **headers: str) -> Behaviour:
    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        raw = body.encode()
        given = {"Content-Type": "application/json", "Content-Length": str(len(raw))}
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        lines = [f"{name}: {value}\r\n" for name, value in (given | named).items()]
        writer.write(f"HTTP/1.1 {code} Test\r\n{''.join(lines)}\r\n".encode() + raw)
        await writer.drain()

    return behave


def refuses(number: int, message: str, **more: Any) -> Behaviour:
    """OpenAI's error."""
    return status(number, json.dumps({"error": {"message": message, **more}}))


def hangs() -> Behaviour:
    async def behave(*_: Any) -> None:
        await asyncio.Event().wait()

    return behave


def drips(pause_s: float = 0.02) -> Behaviour:
    """A body that grows by one byte now and then, and never ends."""

    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")
        while True:
            writer.write(b" ")
            await writer.drain()
            await asyncio.sleep(pause_s)

    return behave


def breaks_off(sent: bytes) -> Behaviour:
    """Closes the connection after some bytes."""

    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        writer.write(sent)
        await writer.drain()
        raise ConnectionResetError

    return behave


def resets() -> Behaviour:
    """Ends the connection with a reset, without a word."""

    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        connection = writer.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        writer.transport.abort()
        raise ConnectionResetError

    return behave


def floods(size: int) -> Behaviour:
    """A body of so many bytes."""

    async def behave(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
    ) -> None:
        writer.write(f"HTTP/1.1 200 OK\r\nContent-Length: {size}\r\n\r\n".encode())
        block = b" " * 65536
        for _ in range(size // len(block) + 1):
            writer.write(block)
            await writer.drain()

    return behave


@contextmanager
def serving_model(*plan: Behaviour) -> Generator[ModelServer]:
    """A server on a free port."""
    server = ModelServer()
    server.plan.extend(plan)
    server.start()
    try:
        yield server
    finally:
        server.stop()
