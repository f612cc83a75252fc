"""Makes readers of wishes from the gateway's back ends."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from llm_gateway.backends.base import Backend
from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import ADAPTER, DEFAULT_MODEL, find_model
from llm_gateway.model import Prompt, Reply
from swarm.errors import GatewayError
from swarm.log import make_logger

CONTEXT = 1536
"""Tokens of the longest wish and its answer."""
TIMEOUT_S = 20.0


class BackendReader:
    """Asks a back end that lives on an event loop of another thread. Implements `Reader`."""

    def __init__(
        self,
        backend: Backend,
        loop: asyncio.AbstractEventLoop,
        *,
        trained: bool,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        self._backend = backend
        self._loop = loop
        self._timeout_s = timeout_s
        self.trained = trained

    @property
    def model(self) -> str:
        """The back end's."""
        return self._backend.model + ("+wishes" if self.trained else "")

    def read(self, prompt: Prompt) -> Reply:
        """Waits for the answer; never on the loop's own thread. Raises GatewayError."""
        asked = self._backend.complete(prompt, self._timeout_s)
        future = asyncio.run_coroutine_threadsafe(asked, self._loop)
        try:
            return future.result(self._timeout_s + 1)
        except TimeoutError:
            future.cancel()
            why = f"no answer in {self._timeout_s:.0f} s"
            raise GatewayError("expired", why) from None


def embedded_backend(threads: int = 0) -> LlamaCpp:
    """The embedded model with its adapter, not started yet; `threads`: 0 takes all cores.

    Raises SettingError where the model is not installed.
    """
    log = make_logger("wishes", level="critical")
    return LlamaCpp(find_model(DEFAULT_MODEL), 1, CONTEXT, threads, log, adapter=ADAPTER)


@contextmanager
def embedded_reader(threads: int = 0) -> Iterator[BackendReader]:
    """The embedded model, started, on a loop of its own; it ends with the block.

    Raises SettingError where it is not installed, or cannot be loaded.
    """
    with running(embedded_backend(threads), trained=True) as reader:
        yield reader


@contextmanager
def running(backend: Backend, *, trained: bool) -> Iterator[BackendReader]:
    """A back end that is started on a loop of its own, and ends with the block."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="wishes", daemon=True)
    thread.start()
    try:
        asyncio.run_coroutine_threadsafe(backend.start(), loop).result()
        try:
            yield BackendReader(backend, loop, trained=trained)
        finally:
            asyncio.run_coroutine_threadsafe(backend.close(), loop).result()
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
