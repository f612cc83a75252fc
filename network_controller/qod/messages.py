"""The bodies of requests and answers, named as in CAMARA Quality-on-Demand 1.1.

Fields that are unknown are ignored, as the definition's schemas allow them: a client of a later
version of the API is answered, too.
"""

from __future__ import annotations

import ipaddress
from datetime import datetime
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

QosStatus = Literal["REQUESTED", "AVAILABLE", "UNAVAILABLE"]
StatusInfo = Literal["DURATION_EXPIRED", "NETWORK_TERMINATED", "DELETE_REQUESTED"]
ProfileStatus = Literal["ACTIVE", "INACTIVE", "DEPRECATED"]
Port = Annotated[int, Meta(ge=0, le=65535)]
Seconds = Annotated[int, Meta(ge=1, le=2**31 - 1)]
ProfileName = Annotated[str, Meta(min_length=3, max_length=256, pattern=r"^[a-zA-Z0-9_.-]+(?!\n)$")]
Ipv4 = Annotated[str, Meta(max_length=15, extra_json_schema={"format": "ipv4"})]
Ipv6 = Annotated[str, Meta(max_length=45, extra_json_schema={"format": "ipv6"})]
Ipv4Range = Annotated[str, Meta(pattern=r"^[0-9.]{7,15}(/[0-9]{1,2})?(?!\n)$")]
Ipv6Range = Annotated[str, Meta(pattern=r"^[0-9a-fA-F:.]{2,45}(/[0-9]{1,3})?(?!\n)$")]
Secret = Annotated[str, Meta(min_length=1, max_length=8192)]
_SOME = Meta(extra_json_schema={"minProperties": 1})
_BESIDE = Meta(
    extra_json_schema={"anyOf": [{"required": ["privateAddress"]}, {"required": ["publicPort"]}]}
)


class Request(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """Base of what clients send."""


class Answer(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """Base of what clients get."""


def _need_one(of: msgspec.Struct) -> None:
    names = of.__struct_fields__
    if all(getattr(of, name) is UNSET for name in names):
        raise ValueError(f"at least one of {', '.join(of.__struct_encode_fields__)} is needed")


class Ipv4Address(Request, frozen=True, kw_only=True):
    """How a device's IPv4 address is told: as others see it, and how the device itself does."""

    public_address: Ipv4
    private_address: Ipv4 | UnsetType = UNSET
    public_port: Port | UnsetType = UNSET

    def __post_init__(self) -> None:
        if self.private_address is UNSET and self.public_port is UNSET:
            raise ValueError("privateAddress or publicPort is needed beside publicAddress")
        for address in self.addresses:
            ipaddress.IPv4Address(address)

    @property
    def addresses(self) -> tuple[str, ...]:
        """What to look the device up by, in this order; they are the same where there is no NAT."""
        if self.private_address is UNSET:
            return (self.public_address,)
        return (self.private_address, self.public_address)


class Device(Request, frozen=True, kw_only=True):
    """One device by one or several identifiers; here only the IPv4 address finds it."""

    phone_number: Annotated[str, Meta(pattern=r"^\+[1-9][0-9]{4,14}(?!\n)$")] | UnsetType = UNSET
    network_access_identifier: Annotated[str, Meta(max_length=320)] | UnsetType = UNSET
    ipv4_address: Annotated[Ipv4Address, _BESIDE] | UnsetType = UNSET
    ipv6_address: Ipv6 | UnsetType = UNSET

    def __post_init__(self) -> None:
        _need_one(self)
        if self.ipv6_address is not UNSET:
            ipaddress.IPv6Address(self.ipv6_address)


class ApplicationServer(Request, frozen=True, kw_only=True):
    """The other end of the flows: addresses or subnets."""

    ipv4_address: Ipv4Range | UnsetType = UNSET
    ipv6_address: Ipv6Range | UnsetType = UNSET

    def __post_init__(self) -> None:
        _need_one(self)
        if self.ipv4_address is not UNSET:
            ipaddress.IPv4Network(self.ipv4_address, strict=False)
        if self.ipv6_address is not UNSET:
            ipaddress.IPv6Network(self.ipv6_address, strict=False)


class PortRange(Request, frozen=True, kw_only=True):
    """Ports from the first to the last, both included."""

    from_: Port = msgspec.field(name="from")
    to: Port

    def __post_init__(self) -> None:
        if self.from_ > self.to:
            raise ValueError(f"from {self.from_} is above to {self.to}")


class PortsSpec(Request, frozen=True, kw_only=True):
    """TCP or UDP ports, one by one and in ranges."""

    ranges: Annotated[tuple[PortRange, ...], Meta(min_length=1, max_length=100)] | UnsetType = UNSET
    ports: Annotated[tuple[Port, ...], Meta(min_length=1, max_length=100)] | UnsetType = UNSET

    def __post_init__(self) -> None:
        _need_one(self)


class SinkCredential(Request, frozen=True, kw_only=True):
    """What the sink wants to be shown; only an access token is of use. Never sent back."""

    credential_type: Literal["PLAIN", "ACCESSTOKEN", "REFRESHTOKEN"]
    access_token: Secret | UnsetType = UNSET
    access_token_expires_utc: Annotated[datetime, Meta(tz=True)] | UnsetType = UNSET
    access_token_type: Annotated[str, Meta(max_length=32)] | UnsetType = UNSET
    identifier: Secret | UnsetType = UNSET
    secret: Secret | UnsetType = UNSET
    refresh_token: Secret | UnsetType = UNSET
    refresh_token_endpoint: Secret | UnsetType = UNSET


class CreateSession(Request, frozen=True, kw_only=True):
    """A wish for quality between a device and an application server, for some seconds."""

    device: Annotated[Device, _SOME] | UnsetType = UNSET
    application_server: Annotated[ApplicationServer, _SOME]
    device_ports: Annotated[PortsSpec, _SOME] | UnsetType = UNSET
    application_server_ports: Annotated[PortsSpec, _SOME] | UnsetType = UNSET
    qos_profile: ProfileName
    sink: Annotated[str, Meta(max_length=2048)] | UnsetType = UNSET
    """Where events are POSTed to."""
    sink_credential: SinkCredential | UnsetType = UNSET
    duration: Seconds


class SessionInfo(Answer, frozen=True, kw_only=True):
    """A session as it stands."""

    device: Device
    """With the one identifier that found it."""
    application_server: ApplicationServer
    device_ports: PortsSpec | UnsetType = UNSET
    application_server_ports: PortsSpec | UnsetType = UNSET
    qos_profile: ProfileName
    sink: str | UnsetType = UNSET
    session_id: Annotated[str, Meta(extra_json_schema={"format": "uuid"})]
    duration: Seconds
    """Granted; once the session has ended, how long it was in force."""
    started_at: Annotated[datetime, Meta(tz=True)] | UnsetType = UNSET
    expires_at: Annotated[datetime, Meta(tz=True)] | UnsetType = UNSET
    """Once the session has ended, when it did."""
    qos_status: QosStatus
    status_info: StatusInfo | UnsetType = UNSET


class ExtendSessionDuration(Request, frozen=True, kw_only=True):
    """More time for a session in force."""

    requested_additional_duration: Seconds


class RetrieveSessionsInput(Request, frozen=True, kw_only=True):
    """Whose sessions are asked for."""

    device: Annotated[Device, _SOME] | UnsetType = UNSET


RateUnit = Literal["bps", "kbps", "Mbps", "Gbps", "Tbps"]


class Rate(Answer, frozen=True, kw_only=True):
    """A rate in the API's form: a number up to 1024 and its unit."""

    value: Annotated[int, Meta(ge=0, le=1024)]
    unit: RateUnit


class Duration(Answer, frozen=True, kw_only=True):
    """A time in the API's form."""

    value: Seconds
    unit: Literal["Seconds"] = "Seconds"


class QosProfile(Answer, frozen=True, kw_only=True):
    """What a profile promises."""

    name: ProfileName
    description: str
    status: ProfileStatus
    target_min_downstream_rate: Rate | UnsetType = UNSET
    """Rounded down; only where the device is known, because it is a share of its link."""
    min_duration: Duration
    max_duration: Duration


class QosProfileRequest(Request, frozen=True, kw_only=True):
    """Which profiles are asked for; nothing asks for all."""

    device: Annotated[Device, _SOME] | UnsetType = UNSET
    name: ProfileName | UnsetType = UNSET
    status: ProfileStatus | UnsetType = UNSET


class StatusChange(Answer, frozen=True, kw_only=True):
    """What has become of a session."""

    session_id: str
    qos_status: Literal["AVAILABLE", "UNAVAILABLE"]
    status_info: StatusInfo | UnsetType = UNSET


class StatusEvent(msgspec.Struct, frozen=True, kw_only=True):
    """A CloudEvent (1.0, structured mode) as sinks get it."""

    id: str
    source: str
    time: Annotated[datetime, Meta(tz=True)]
    data: StatusChange
    type: Literal["org.camaraproject.quality-on-demand.v1.qos-status-changed"] = (
        "org.camaraproject.quality-on-demand.v1.qos-status-changed"
    )
    specversion: Literal["1.0"] = "1.0"
    datacontenttype: Literal["application/json"] = "application/json"


def read(raw: bytes, kind: Any) -> Any:
    """A body of the given kind. Raises msgspec.DecodeError with the place and what is allowed."""
    try:
        return msgspec.json.decode(raw, type=kind)
    except (UnicodeDecodeError, RecursionError) as error:
        raise msgspec.DecodeError(f"JSON is malformed: {error}") from error
