"""The interface of a driver: finds a swarm's links, shapes them, reads them back.

A new one is a file beside this one with `DRIVERS = (MyDriver,)`, made with the swarm's name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol

from network_controller.model import Capabilities, Link, LinkReading, LinkShape


class Running(Protocol):
    """A program that was started at a robot."""

    def poll(self) -> int | None:
        """Its exit status, or None while it runs."""
        ...


class Driver(Protocol):
    """Shapes the links of one swarm on this host, and no others.

    Methods are called from one thread at a time. A link whose robot has left or whose interface is
    another one since (a container that was restarted) is found anew by each call.
    """

    name: str
    one_tree: bool
    """Whether links that share a medium lend each other what they leave unused, where the kernel
    can; otherwise each is shaped to its own part."""

    def robots(self) -> Mapping[str, str]:
        """The robots (and egos) whose links are on this host now, with their IPv4 address."""
        ...

    def capabilities(self) -> Capabilities:
        """What the kernel can do here, found out by trying on an interface of its own.

        Raises NetworkError when nothing can be tried: no NET_ADMIN, no `tc`.
        """
        ...

    def apply(self, link: Link, shape: LinkShape) -> None:
        """Shapes a link and reads it back; queues keep what they hold where it was shaped already.

        When anything fails, the link is as it was before. Raises LinkGoneError for a link that is
        not there, NetworkError with the kernel's words for everything else.
        """
        ...

    def read(self, links: Collection[Link]) -> Mapping[Link, LinkReading]:
        """Shapes and counters of links; those that are gone or not shaped are left out."""
        ...

    def clear(self, link: Link) -> None:
        """Makes a link unshaped. Clearing twice, or a link that is gone, is no error."""
        ...

    def shaped(self) -> frozenset[Link]:
        """The links that are shaped now, by whomever: what an earlier controller left, too."""
        ...

    def start_at(self, robot: str, argv: list[str]) -> Running:
        """Starts a program in a robot's network namespace, where `sys.executable` and this
        project can be used; it has to end by itself. Raises LinkGoneError for an unknown robot."""
        ...

    def close(self) -> None:
        """Lets go of connections and helper interfaces that carry no shape."""
        ...
