"""A model that runs here, on the processor, in a process of its own."""

from __future__ import annotations

from llm_gateway.backends.base import Backend, BackendKind
from llm_gateway.settings import GatewaySettings
from swarm.errors import SettingError
from swarm.log import Logger


def _make(settings: GatewaySettings, log: Logger) -> Backend:
    from llm_gateway.backends.llamacpp.client import LlamaCpp
    from llm_gateway.backends.llamacpp.models import ADAPTER, DEFAULT_MODEL, find_model

    if settings.llm_trained and settings.llm_model:
        raise SettingError(
            f"COADAPT_LLM_TRAINED = true does not go with COADAPT_LLM_MODEL = "
            f"{settings.llm_model!r}; allowed: an empty one, the package's own model"
        )
    return LlamaCpp(
        find_model(settings.llm_model or DEFAULT_MODEL),
        settings.llm_parallel,
        settings.llm_context,
        settings.llm_threads,
        log,
        adapter=ADAPTER if settings.llm_trained else None,
    )


BACKENDS = (BackendKind("llamacpp", _make),)
