"""Settings of the network controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

from swarm.defaults import QOD_PORT
from swarm.errors import SettingError
from swarm.http.access import token_of
from swarm.http.hosts import HostNames
from swarm.messages import MAX_RATE_BPS, MIN_RATE_BPS
from swarm.process import SwarmSettings
from swarm.settings import NAME_RULE, Name, Port, Secret, load, shown

MAX_NAME = 21
"""Of a controller's name: a certificate's common name has the role before it."""
_NAME = rf"^[A-Za-z0-9_-]{{0,{MAX_NAME}}}(?!\n)$"

Rate = Annotated[int, msgspec.Meta(ge=MIN_RATE_BPS, le=MAX_RATE_BPS)]


class ControllerSettings(SwarmSettings, frozen=True, kw_only=True):
    """How the links of one host are controlled. Field `driver` is read from `COADAPT_DRIVER`."""

    driver: Name = "netns"
    controller: Annotated[
        str, msgspec.Meta(pattern=_NAME, description=f"empty, or {NAME_RULE} of {MAX_NAME} at most")
    ] = ""
    """Its name, where hosts have one each: it answers on `net/shape/<controller>`, and in a secure
    swarm its certificate says `controller-<controller>`. Empty for the only one."""
    ego: Name = "R1"
    """Whose link is the cell that a request without a robot means."""
    egos: tuple[Name, ...] = ()
    """All egos, where there are several: their links are shaped alike, from the start and by such
    requests."""
    cell: Literal["own", "shared"] = "own"
    """Whether each ego's link is a cell of its own, or all together are one medium: each has its
    part of the time, at the capacity that is wanted for its own link."""
    ego_standby: Name | None = None
    """The ego that stands in for it: its link is shaped alike, from the start and by such requests.
    """
    link_bps: Rate | None = None
    """Capacity of the cell from the start; None leaves it unshaped until somebody asks."""
    link_rates_bps: tuple[Rate, ...] = ()
    """Capacities that follow one another instead, each for `link_interval_s`, since `epoch_ns`."""
    link_interval_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600)] = 1.0
    epoch_ns: Annotated[int, msgspec.Meta(ge=0)] = 0
    state_file: str = ""
    """Keeps operators' shapes over a restart of the controller; empty forgets them."""
    net_journal: str = ""
    """Path of the journal of actions; empty keeps none."""
    window_s: Annotated[float, msgspec.Meta(ge=0.1, le=600)] = 5.0
    """A shortfall counts when it lasts for a whole window."""
    windows: Annotated[int, msgspec.Meta(ge=1, le=100)] = 3
    """Windows of shortfall, or of ease, in a row before the controller acts."""
    qod_host: str = "127.0.0.1"
    qod_port: Port = QOD_PORT
    """Where the Quality-on-Demand API answers; 0 takes any free port."""
    qod_token: Secret = ""
    """Bearer token that clients must show; needed to answer off this host."""
    qod_token_file: str = ""
    """A file that holds the token instead."""
    qod_names: HostNames = ()
    """Names, beside localhost and addresses, that clients may ask for."""
    qod_socket: str = ""
    """Unix socket to answer on instead of the port."""
    qod_sinks: Annotated[tuple[str, ...], msgspec.Meta(max_length=64)] = ()
    """Networks, addresses and host names that events may be sent to though they are not public."""

    @property
    def cells(self) -> tuple[str, ...]:
        """The robots towards which the cells are, the first ego's first."""
        others = (*self.egos, *((self.ego_standby,) if self.ego_standby else ()))
        return tuple(dict.fromkeys((self.ego, *others)))

    def __repr__(self) -> str:
        return shown(self)


def load_settings(environment: Mapping[str, str] | None = None) -> ControllerSettings:
    """The settings from the environment and the TOML file.

    Raises SettingError that names the variable, its value and what is allowed.
    """
    settings = load(ControllerSettings, environment)
    if settings.link_bps is not None and settings.link_rates_bps:
        raise SettingError(
            "COADAPT_LINK_BPS and COADAPT_LINK_RATES_BPS are both set; set one of them"
        )
    token = token_of("COADAPT_QOD_TOKEN", settings.qod_token, settings.qod_token_file)
    return msgspec.structs.replace(settings, qod_token=token)
