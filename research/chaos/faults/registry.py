"""All kinds of faults by name."""

from __future__ import annotations

from collections.abc import Mapping

from research.chaos.faults import certificates, clocks, disks, links, outsiders, processes
from research.chaos.faults.base import Kind

KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for module in (processes, links, disks, clocks, certificates, outsiders)
    for kind in module.KINDS
}
KNOWN = ("withdrawn-server",)
"""Kinds that break a swarm without identities, for a reason that docs/chaos.md tells; in one they
are played only when they are asked for."""
