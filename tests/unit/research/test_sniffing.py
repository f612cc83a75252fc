"""Packets are told apart by the port of their router, their mark and what they carry."""

from __future__ import annotations

import struct

import pytest

from research.benchmarks.sniffing import PORTS, Packet, read
from swarm.traffic import TrafficClass


def packet(source: int, target: int, *, tos: int = 0x88, payload: int = 5, proto: int = 6) -> bytes:
    """The heads of an IPv4 packet with 12 bytes of TCP's options."""
    ip = struct.pack("!BBHHHBBH8x", 0x45, tos, 20 + 32 + payload, 0, 0, 64, proto, 0)
    return ip + struct.pack("!HHIIBB6x12x", source, target, 0, 0, 8 << 4, 0)


def test_both_directions_of_a_class_are_read() -> None:
    assert [PORTS[port] for port in (7447, 7448, 7449)] == list(TrafficClass)
    there = Packet(TrafficClass.FUSION, 0x88, 5)
    assert read(packet(40000, 7448)) == read(packet(7448, 40000)) == there


def test_bits_that_tell_of_congestion_are_no_mark() -> None:
    told = read(packet(40000, 7447, tos=0xB8 | 0b11, payload=0))
    assert told == Packet(TrafficClass.CONTROL, 0xB8, 0)


@pytest.mark.parametrize("data", [b"", packet(1, 2), packet(40000, 7448, proto=17)])
def test_what_is_no_routers_is_not_counted(data: bytes) -> None:
    assert read(data) is None
