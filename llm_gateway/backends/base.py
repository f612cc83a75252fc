"""The interface of a back end: it answers prompts, several at a time.

A new one is a file beside this one with `BACKENDS = (BackendKind("name", make),)`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from llm_gateway.model import Hear, Prompt, Reply
from llm_gateway.settings import GatewaySettings
from swarm.log import Logger


class Backend(Protocol):
    """Runs on the gateway's event loop and never blocks it."""

    name: str

    @property
    def model(self) -> str:
        """The model that answers, as metrics, journals and the cache call it."""
        ...

    @property
    def parallel(self) -> int:
        """How many prompts it works on at a time; what comes in together is read together."""
        ...

    @property
    def trouble(self) -> str:
        """Why no prompt can be answered now; empty where one can, or nobody knows."""
        ...

    async def start(self) -> None:
        """Prepares what can be prepared; a model that cannot be reached yet is no error.

        Raises SettingError for what no waiting can mend.
        """
        ...

    async def complete(self, prompt: Prompt, timeout_s: float, hear: Hear | None = None) -> Reply:
        """The model's words. Cancelling stops the work on it.

        `hear` is told them while they come, where that can be done. They may go on behind a stop
        sequence: what a back end cannot do about `stop`, the gateway does.

        Raises GatewayError: `expired` after `timeout_s`, `too_large` for a prompt that the model
        cannot read, `unavailable` where nobody answers or says to come back later, `failed`.
        """
        ...

    async def close(self) -> None:
        """Ends what was started; prompts under way fail with `unavailable`."""
        ...


@dataclass(frozen=True, slots=True)
class BackendKind:
    """One kind of back end."""

    name: str
    make: Callable[[GatewaySettings, Logger], Backend]
    """Imports what is heavy when it is called; raises SettingError for what it cannot work with."""
