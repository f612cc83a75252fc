"""`ifb` devices: what is redirected to one waits in its queue, and goes on from there."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping

from network_controller.drivers.command import attempt, run, words
from network_controller.drivers.interfaces import facts_of, index_of
from swarm.errors import NetworkError

IFB_PREFIX = "ifb-"
IFB_MARK = "coadapt "
"""How the alias of our `ifb` devices begins, before the interface that they queue for."""
MAX_NAME = 15
"""Of an interface, in bytes."""


def ifb_of(owner: str) -> str:
    """The name of the device that queues for an interface: what comes through a link's end, or
    what goes to the links that share the medium behind a bridge."""
    name = IFB_PREFIX + owner
    if len(name) <= MAX_NAME:
        return name
    return IFB_PREFIX + hashlib.blake2s(owner.encode(), digest_size=5).hexdigest()


def make_ifb(ifb: str, owner: str) -> None:
    """Makes it unless it is there. Raises NetworkError, also where it is somebody else's."""
    if not index_of(ifb):
        # By one process, so that none is left behind that nobody knows whose it is.
        lines = f"link add {ifb} type ifb\nlink set {ifb} alias '{IFB_MARK}{owner}' up\n"
        try:
            run("ip", "-batch", "-", text=lines)
        except NetworkError:
            attempt("ip", "link", "del", ifb)
            raise
    elif not is_ours(ifb):
        raise NetworkError(
            f"interface {ifb}, which should queue for {owner}, is not the swarm's: "
            f"its alias does not begin with {IFB_MARK.strip()!r}; rename or remove it"
        )


def remove_ifb(ifb: str) -> None:
    """Removes it if it is ours; whatever is still redirected to it is lost. Raises NetworkError
    when it stays."""
    if is_ours(ifb):
        done = attempt("ip", "link", "del", ifb)
        if done.returncode != 0 and index_of(ifb):
            raise NetworkError(f"ip does not remove {ifb}: {words(done)}")


def orphans(owners: Collection[str]) -> tuple[str, ...]:
    """Our `ifb` devices that belong to none of these interfaces: their links are gone."""
    shown = json.loads(run("ip", "-j", "link", "show", "type", "ifb") or "[]")
    names = {one["ifname"] for one in shown if _marked(one)}
    return tuple(sorted(names - {ifb_of(owner) for owner in owners}))


def is_ours(ifb: str) -> bool:
    """Whether there is such a device and this project made it."""
    return bool(index_of(ifb)) and _marked(facts_of(ifb))


def _marked(facts: Mapping[str, object]) -> bool:
    return str(facts.get("ifalias", "")).startswith(IFB_MARK)
