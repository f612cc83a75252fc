"""Settings of the console."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec

from swarm.defaults import COMM_RANGE_M, CONSOLE_PORT, CommRange
from swarm.http.access import token_of
from swarm.http.hosts import HostNames
from swarm.process import ProcessSettings
from swarm.settings import Name, Port, Secret, load, shown

_HOST = r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?"
ServerUrl = Annotated[
    str,
    msgspec.Meta(
        pattern=rf"^(http://{_HOST})?(?!\n)$",
        max_length=300,
        description="http://host[:port], without TLS and without a user,",
    ),
]
"""`http://host[:port]`: it is asked without TLS and without a user, and told to whoever looks."""
LinkUrl = Annotated[str, msgspec.Meta(pattern=rf"^(https?://{_HOST})?(?!\n)$", max_length=300)]


class ConsoleSettings(ProcessSettings, frozen=True, kw_only=True):
    """Whom the console shows, and where. Field `console_port` is read from `COADAPT_CONSOLE_PORT`.

    Of the world's settings it uses those that a simulated floor plan follows from.
    """

    ego: Name
    """Whose decisions are shown, unless a page asks for another one of `egos`."""
    egos: tuple[Name, ...] = ()
    """All that decide, where there are several."""
    comm_range_m: CommRange = COMM_RANGE_M
    """How far from the ego a robot may take part: the ego's own setting, shown as a reason."""
    console_host: str = "127.0.0.1"
    console_port: Port = CONSOLE_PORT
    """0 takes any free port."""
    console_token: Secret = ""
    """What viewers must show; needed to answer off this host."""
    console_token_file: str = ""
    """A file that holds the token instead."""
    console_names: HostNames = ()
    """Names, beside localhost and addresses, that browsers may ask for."""

    console_prometheus: ServerUrl = ""
    """Where the console asks Prometheus for alerts and history; empty: nowhere."""
    console_prometheus_link: LinkUrl = ""
    """Where people's browsers reach it."""
    console_recordings: str = ""
    """The folder of the swarm's recordings; empty: none is shown."""
    console_site: str = ""
    """The site file, with names of places, which pages may change; one that is not there is made.
    Empty: none can be drawn. Without a file a simulated factory has its own places."""

    def __repr__(self) -> str:
        return shown(self)


def load_settings(environment: Mapping[str, str] | None = None) -> ConsoleSettings:
    """The settings from the environment and the TOML file.

    Raises SettingError that names the variable, its value (never a token) and what is allowed.
    """
    settings = load(ConsoleSettings, environment)
    token = token_of("COADAPT_CONSOLE_TOKEN", settings.console_token, settings.console_token_file)
    return msgspec.structs.replace(settings, console_token=token)
