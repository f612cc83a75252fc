"""The interface of a back end: it answers prompts, several at a time.

A new back end is a new file beside this one and a line in `registry.py`.
"""

from __future__ import annotations

from typing import Protocol

from llm_gateway.model import Prompt, Reply


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

    async def start(self) -> None:
        """Prepares what can be prepared; a model that cannot be reached yet is no error.

        Raises SettingError for what no waiting can mend.
        """
        ...

    async def complete(self, prompt: Prompt, timeout_s: float) -> Reply:
        """The model's words. Cancelling stops the work on it.

        Raises GatewayError: `expired` after `timeout_s`, `too_large` for a prompt that the model
        cannot read, `unavailable` where nobody answers or says to come back later, `failed`.
        """
        ...

    async def close(self) -> None:
        """Ends what was started; prompts under way fail with `unavailable`."""
        ...
