"""Back ends by name: every module of this package that has `BACKENDS` adds them."""

from __future__ import annotations

from llm_gateway.backends.base import Backend, BackendKind
from llm_gateway.settings import GatewaySettings
from swarm.errors import SettingError
from swarm.log import Logger
from swarm.registry import by_name, registered


def make_backend(settings: GatewaySettings, log: Logger) -> Backend:
    """The back end that the settings name; its libraries are loaded only now.

    Raises SettingError for an unknown one, and for what it cannot work with.
    """
    name = settings.llm_backend
    found: dict[str, BackendKind] = by_name(
        registered("BACKENDS", "llm_gateway.backends"), "back ends", SettingError
    )
    if name not in found:
        raise SettingError(
            f"COADAPT_LLM_BACKEND = {name!r} is not valid; allowed: {', '.join(found)}"
        )
    return found[name].make(settings, log)
