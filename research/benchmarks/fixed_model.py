"""A model server whose answers take a fixed time: what else a request takes is somebody's overhead.

An answer says how long it really took here, so that waiting for a processor before the server's
own timer fires is not taken for the gateway's.

`python -m research.benchmarks.fixed_model PORT SECONDS`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time

MODEL = "fixed"
SCHEMA = {
    "type": "object",
    "properties": {"model_ms": {"type": "number"}, "calls": {"type": "integer"}},
    "required": ["model_ms", "calls"],
    "additionalProperties": False,
}
"""Of an answer: how long it took the server, and how many completions it was asked for so far."""


class FixedModel:
    """Speaks just enough HTTP for clients that keep their connections."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._calls = 0

    async def serve(self, port: int) -> None:
        """Until it is cancelled."""
        async with await asyncio.start_server(self._client, "127.0.0.1", port, backlog=256) as own:
            await own.serve_forever()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = (await reader.readuntil(b"\r\n\r\n")).lower()
                begun = time.monotonic()
                _, _, rest = head.partition(b"content-length:")
                if rest:
                    await reader.readexactly(int(rest.split(b"\r\n", 1)[0]))
                writer.write(await self._answer(head, begun))
                await writer.drain()
        writer.close()

    async def _answer(self, head: bytes, begun: float) -> bytes:
        if head.startswith(b"get"):
            return _response({"object": "list", "data": [{"id": MODEL, "object": "model"}]})
        self._calls += 1
        calls = self._calls
        await asyncio.sleep(self._seconds)
        took_ms = (time.monotonic() - begun) * 1e3
        message = {
            "role": "assistant",
            "content": json.dumps({"model_ms": took_ms, "calls": calls}),
        }
        return _response(
            {
                "id": f"chatcmpl-{calls}",
                "object": "chat.completion",
                "created": int(time.time()),
                "model": MODEL,
                "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
                "usage": {"prompt_tokens": 1000, "completion_tokens": 20, "total_tokens": 1020},
            }
        )


def _response(body: object) -> bytes:
    raw = json.dumps(body).encode()
    head = (
        f"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {len(raw)}\r\n\r\n"
    )
    return head.encode() + raw


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(FixedModel(float(sys.argv[2])).serve(int(sys.argv[1])))
