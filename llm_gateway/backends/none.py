"""No model: every prompt is refused, so that egos decide by their fallback."""

from __future__ import annotations

from llm_gateway.backends.base import BackendKind
from llm_gateway.model import Hear, Prompt, Reply
from swarm.errors import GatewayError


class NoBackend:
    """The back end of a gateway that only keeps its endpoints open."""

    name = "none"
    model = "none"
    parallel = 1
    trouble = ""

    async def start(self) -> None:
        """Has nothing to prepare."""

    async def complete(self, prompt: Prompt, timeout_s: float, hear: Hear | None = None) -> Reply:
        """Raises GatewayError `unavailable`."""
        raise GatewayError("unavailable", "no model: COADAPT_LLM_BACKEND is none")

    async def close(self) -> None:
        """Has nothing to end."""


BACKENDS = (BackendKind("none", lambda settings, log: NoBackend()),)
