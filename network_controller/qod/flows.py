"""Whether two sessions want quality for the same packets."""

from __future__ import annotations

import ipaddress

from msgspec import UNSET, UnsetType

from network_controller.qod.messages import ApplicationServer, CreateSession, PortsSpec


def overlap(one: CreateSession, other: CreateSession) -> bool:
    """Whether some flow of a device, which is the same, would be part of both sessions."""
    return (
        _servers_overlap(one.application_server, other.application_server)
        and _ports_overlap(one.device_ports, other.device_ports)
        and _ports_overlap(one.application_server_ports, other.application_server_ports)
    )


def _servers_overlap(one: ApplicationServer, other: ApplicationServer) -> bool:
    if one.ipv4_address is not UNSET and other.ipv4_address is not UNSET:
        mine = ipaddress.IPv4Network(one.ipv4_address, strict=False)
        if mine.overlaps(ipaddress.IPv4Network(other.ipv4_address, strict=False)):
            return True
    if one.ipv6_address is not UNSET and other.ipv6_address is not UNSET:
        wide = ipaddress.IPv6Network(one.ipv6_address, strict=False)
        return wide.overlaps(ipaddress.IPv6Network(other.ipv6_address, strict=False))
    return False


def _ports_overlap(one: PortsSpec | UnsetType, other: PortsSpec | UnsetType) -> bool:
    return any(
        low <= other_high and other_low <= high
        for low, high in _ranges(one)
        for other_low, other_high in _ranges(other)
    )


def _ranges(ports: PortsSpec | UnsetType) -> list[tuple[int, int]]:
    if ports is UNSET:
        return [(0, 65535)]
    ranges = [] if ports.ranges is UNSET else [(one.from_, one.to) for one in ports.ranges]
    single = [] if ports.ports is UNSET else [(port, port) for port in ports.ports]
    return ranges + single
