"""How long messages take the medium of one Wi-Fi cell: frames, pauses, acknowledgements.

One 20 MHz channel, one spatial stream, one access category. A station waits DIFS and a random
back-off of half of CWmin on average before it sends (IEEE 802.11-2020, 10.3 and 19.4.4; the sums
are those of Jun, Peddabachagari and Sichitiu, "Theoretical maximum throughput of IEEE 802.11 and
its applications", NCA 2003). Unicast goes as one aggregate (A-MPDU) and is acknowledged by a block
acknowledgement; collisions and losses are left out. What an access point sends to a group goes
packet by packet at one of the channel's basic rates, without an acknowledgement and without
aggregation (RFC 9119, 3.1), so that every station can hear it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarm.errors import EvaluationError

SLOT_S, SIFS_S, DIFS_S = 9e-6, 16e-6, 34e-6
BACKOFF_S = 7.5 * SLOT_S
"""Half of CWmin 15."""
HT_PREAMBLE_S, LEGACY_PREAMBLE_S = 36e-6, 20e-6
ACK_S = LEGACY_PREAMBLE_S + 8e-6
BLOCK_ACK_S = LEGACY_PREAMBLE_S + 12e-6
"""14 and 32 bytes at 24 Mbit/s."""
PACKET_BYTES = 1448
"""What TCP carries in a packet of 1,500 bytes."""
TCP_HEADERS, UDP_HEADERS = 52, 28
MAC_BYTES = 46
"""MAC header, checksum, LLC and the delimiter of an aggregate, a packet."""
GOODPUT_PACKETS = 16
"""In each aggregate of the stream whose goodput a cell is named after."""


@dataclass(frozen=True, slots=True)
class Station:
    """One end of the medium's unicast: how fast bits go between it and the access point."""

    rate_bps: float
    """Of the physical layer."""

    def unicast_s(self, size: int) -> float:
        """Airtime of a message in one direction over TCP: with TCP's own acknowledgements the
        other way, one for two packets."""
        packets = max(1, math.ceil(size / PACKET_BYTES))
        data = self._access_s(size + packets * (TCP_HEADERS + MAC_BYTES)) + BLOCK_ACK_S
        acks = math.ceil(packets / 2) * (self._access_s(TCP_HEADERS + MAC_BYTES) + ACK_S)
        return data + acks

    def _access_s(self, size: int) -> float:
        return DIFS_S + BACKOFF_S + HT_PREAMBLE_S + 8.0 * size / self.rate_bps + SIFS_S


def group_s(size: int, rate_bps: float) -> float:
    """Airtime of a message to a group, over UDP at a basic rate (6, 12 or 24 Mbit/s)."""
    whole = PACKET_BYTES + TCP_HEADERS - UDP_HEADERS
    packets = max(1, math.ceil(size / whole))
    on_air = 8.0 * (size + packets * (UDP_HEADERS + MAC_BYTES)) / rate_bps
    return packets * (DIFS_S + BACKOFF_S + LEGACY_PREAMBLE_S) + on_air


def station_of(goodput_bps: float) -> Station:
    """The station whose downloads of full aggregates reach that goodput, when it is alone.

    Raises EvaluationError for one that no rate reaches.
    """
    bits = 8.0 * GOODPUT_PACKETS * (PACKET_BYTES + TCP_HEADERS)
    spent_s = DIFS_S + BACKOFF_S + HT_PREAMBLE_S + SIFS_S + BLOCK_ACK_S
    left_s = bits / goodput_bps - spent_s
    if left_s <= 0.0:
        raise EvaluationError(
            f"no rate gives {goodput_bps:g} bit/s: pauses alone take {spent_s:g} s"
        )
    return Station((bits + 8.0 * GOODPUT_PACKETS * MAC_BYTES) / left_s)


def jain(shares: list[float]) -> float:
    """Jain's index of fairness, 1 where all have the same: (sum x)^2 / (n sum x^2) (Jain, Chiu and
    Hawe, 1984). 1 of nothing."""
    squares = sum(share * share for share in shares)
    return sum(shares) ** 2 / (len(shares) * squares) if squares else 1.0
