"""Back ends by name."""

from __future__ import annotations

from llm_gateway.backends.base import Backend
from llm_gateway.backends.none import NoBackend
from llm_gateway.settings import GatewaySettings
from swarm.errors import SettingError
from swarm.log import Logger


def make_backend(settings: GatewaySettings, log: Logger) -> Backend:
    """The back end that the settings name; its libraries are loaded only now.

    Raises SettingError for what it cannot work with.
    """
    if settings.llm_backend == "openai":
        return _openai(settings, log)
    if settings.llm_backend == "llamacpp":
        return _llamacpp(settings, log)
    return NoBackend()


def _openai(settings: GatewaySettings, log: Logger) -> Backend:
    from llm_gateway.backends.openai import OpenAi

    try:
        return OpenAi(
            settings.llm_url, settings.llm_model, settings.llm_api_key, settings.llm_parallel, log
        )
    except SettingError as error:
        raise SettingError(f"COADAPT_LLM_URL: {error}") from error


def _llamacpp(settings: GatewaySettings, log: Logger) -> Backend:
    from llm_gateway.backends.llamacpp.client import LlamaCpp
    from llm_gateway.backends.llamacpp.models import DEFAULT_MODEL, find_model

    return LlamaCpp(
        find_model(settings.llm_model or DEFAULT_MODEL),
        settings.llm_parallel,
        settings.llm_context,
        settings.llm_threads,
        log,
    )
