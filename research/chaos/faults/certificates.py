"""Certificates that are renewed out of turn."""

from __future__ import annotations

from deploy.trust.prepare import keystore_of
from research.chaos.faults.base import End, Kind
from research.chaos.history import Fault
from research.chaos.stage import Stage

ROUTER = "router"


def _renew(stage: Stage, fault: Fault) -> End:
    """Of the router, which opens anew with it, or of one robot, which connects again."""
    name = fault.target or ROUTER
    end = keystore_of(stage.spec.var_dir).renew(name)
    return lambda: f"the new certificate of {name} holds until {end:%F %T} UTC"


KINDS = (
    Kind(
        "renew-router", _renew, (6.0, 8.0), "everybody", (ROUTER,),
        sign="anything", needs="secure",
    ),
    Kind("renew-robot", _renew, (3.0, 5.0), "nobody", targets=True, needs="secure"),
)  # fmt: skip
