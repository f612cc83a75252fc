"""Traffic classes: what a message is for decides its Zenoh priority, its TCP link and its DSCP.

Each class has a TCP link of its own (Zenoh multi-link by priority range), and each link's packets
carry the class's DSCP mark in both directions, so that `tc` can tell the classes apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal

import zenoh

Protocol = Literal["tcp", "tls"]


@dataclass(frozen=True, slots=True)
class _Link:
    priority: int
    priorities: tuple[int, int]
    tos: int
    port_offset: int


class TrafficClass(Enum):
    """The three classes. DSCP values as RFC 4594 recommends: EF, AF41 and CS1."""

    CONTROL = _Link(priority=2, priorities=(1, 3), tos=0xB8, port_offset=0)
    FUSION = _Link(priority=4, priorities=(4, 5), tos=0x88, port_offset=1)
    BACKGROUND = _Link(priority=7, priorities=(6, 7), tos=0x20, port_offset=2)

    @property
    def priority(self) -> zenoh.Priority:
        """The Zenoh priority that messages of this class are sent with."""
        return _PRIORITIES[self.value.priority]

    @property
    def tos(self) -> int:
        """The IP TOS byte of the class's packets: DSCP << 2."""
        return self.value.tos

    def endpoint(self, host: str, port: int, protocol: Protocol = "tcp") -> str:
        """The Zenoh endpoint of this class's link, to listen on or to connect to."""
        low, high = self.value.priorities
        return (
            f"{protocol}/{host}:{port + self.value.port_offset}"
            f"?prio={low}-{high};rel=1#dscp=0x{self.tos:02x}"
        )


_PRIORITIES = {
    2: zenoh.Priority.INTERACTIVE_HIGH,
    4: zenoh.Priority.DATA_HIGH,
    7: zenoh.Priority.BACKGROUND,
}
LINKS = len(TrafficClass)
