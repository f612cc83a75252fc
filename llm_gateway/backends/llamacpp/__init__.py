"""A model that runs here, on the processor, in a process of its own."""

from __future__ import annotations

from llm_gateway.backends.base import Backend, BackendKind
from llm_gateway.settings import GatewaySettings
from swarm.log import Logger


def _make(settings: GatewaySettings, log: Logger) -> Backend:
    from llm_gateway.backends.llamacpp.client import LlamaCpp
    from llm_gateway.backends.llamacpp.models import DEFAULT_MODEL, find_model

    return LlamaCpp(
        find_model(settings.llm_model or DEFAULT_MODEL),
        settings.llm_parallel,
        settings.llm_context,
        settings.llm_threads,
        log,
    )


BACKENDS = (BackendKind("llamacpp", _make),)
