"""Where the controller may send events: to public addresses, and to what the operator lists.

Whoever may create sessions chooses the sink, and reaches through it what the controller reaches
(server-side request forgery). So the addresses count, not what they are written as; they are
checked when the session is created, and again for every event, which goes to the very address that
was checked: a name may lead elsewhere by then (DNS rebinding).
"""

from __future__ import annotations

import ipaddress
import re
import socket
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from ipaddress import IPv4Address, IPv6Address

from network_controller.qod.problems import Problem, invalid_sink
from swarm.errors import SettingError

RESOLVE_S = 3.0
"""How long the answer to who creates a session may wait for the name's addresses."""
RESOLVING = 8
"""Names that are looked up at a time: a lookup cannot be ended."""
MAX_ADDRESSES = 32
"""Of a name; one with more is no sink."""

Address = IPv4Address | IPv6Address
_NAME = re.compile(r"(?=.{1,253}\Z)[A-Za-z0-9_]([A-Za-z0-9._-]*[A-Za-z0-9_])?\.?")
_PUBLIC_V6 = ipaddress.IPv6Network("2000::/3")
_SIX_TO_FOUR = ipaddress.IPv6Network("2002::/16")
# The IPv4 address is the end: NAT64, IPv4-compatible, IPv4-mapped and IPv4-translated addresses.
_ENDING_IN_V4 = tuple(
    ipaddress.IPv6Network(block)
    for block in ("64:ff9b::/96", "::/96", "::ffff:0:0/96", "::ffff:0:0:0/96")
)
_V6_LOOPBACK = (IPv6Address("::"), IPv6Address("::1"))


class Destinations:
    """What a sink's host may be.

    >>> Destinations(["192.168.7.0/24"]).checked("192.168.7.1")
    [IPv4Address('192.168.7.1')]
    """

    def __init__(self, listed: Iterable[str] = ()) -> None:
        """`listed`: networks (`10.1.0.0/16`), addresses and host names that sinks may be at though
        they are not public.

        Raises SettingError.
        """
        self._networks = []
        self._names = set()
        self._places = threading.BoundedSemaphore(RESOLVING)
        for entry in listed:
            try:
                self._networks.append(ipaddress.ip_network(entry))
            except ValueError as error:
                # What looks like an address is none that somebody meant as a name.
                if not _NAME.fullmatch(entry) or not re.search("[A-Za-z]", entry):
                    raise SettingError(
                        f"COADAPT_QOD_SINKS = {entry!r} is not valid: {error}; it must be networks "
                        "(10.1.0.0/16), addresses and host names, separated by commas"
                    ) from error
                self._names.add(entry.lower().rstrip("."))

    def checked(self, host: str) -> list[Address]:
        """The addresses of a host, all of which events may be sent to.

        Raises Problem where one of them is not allowed, and OSError for a name without addresses.
        """
        addresses = [meant(address) for address in resolve(host)]
        if host.lower().rstrip(".") not in self._names:
            for address in addresses:
                self._check(host, address)
        return addresses

    def checked_soon(self, host: str) -> list[Address]:
        """The same for somebody who waits: raises Problem also for a name that has no address, or
        tells none within RESOLVE_S."""
        if not self._places.acquire(blocking=False):
            raise invalid_sink(f"sink's host {host!r} cannot be resolved: too many others are")
        found: Future[list[Address]] = Future()

        def look() -> None:
            try:
                found.set_result(self.checked(host))
            except (Problem, OSError) as error:
                found.set_exception(error)
            finally:
                self._places.release()

        threading.Thread(target=look, name="qod-resolve", daemon=True).start()
        try:
            return found.result(RESOLVE_S)
        except TimeoutError:
            why = f"no answer within {RESOLVE_S:.0f} s"
        except OSError as error:
            why = error.strerror or str(error)
        raise invalid_sink(f"sink's host {host!r} cannot be resolved: {why}")

    def _check(self, host: str, address: Address) -> None:
        if is_public(address) or any(address in network for network in self._networks):
            return
        leads = "is" if host == str(address) else f"leads to {address}, which is"
        raise invalid_sink(
            f"sink's host {host!r} {leads} {_kind(address)}; an address that is not public must be "
            "on the operator's list (COADAPT_QOD_SINKS)"
        )


def resolve(host: str) -> list[str]:
    """The addresses of a name, or of an address in any spelling, as the system tells them.

    Raises OSError where there is none, or there are more than MAX_ADDRESSES.
    """
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except UnicodeError as error:  # a label that is empty or too long
        raise OSError(f"{host!r} is no host name: {error}") from error
    addresses = list(dict.fromkeys(str(entry[4][0]) for entry in found))
    if len(addresses) > MAX_ADDRESSES:
        raise OSError(f"it has {len(addresses)} addresses; allowed: {MAX_ADDRESSES}")
    return addresses


def meant(text: str) -> Address:
    """An address; the IPv4 address itself where it is written as one of IPv6 (`::ffff:127.0.0.1`),
    to which the system connects all the same."""
    address = ipaddress.ip_address(text)
    mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
    return mapped or address


def is_public(address: Address) -> bool:
    """Whether everybody reaches an address, so that to send there tells and opens nothing.

    Not private, loopback, link-local, multicast, unspecified, shared (CGNAT) and reserved ones, nor
    addresses of IPv6 that lead to such ones of IPv4 (6to4, NAT64).
    """
    if isinstance(address, IPv4Address):
        return address.is_global and not (address.is_multicast or address.is_reserved)
    within = list(_within(address))
    if within:
        return all(map(is_public, within))
    return address in _PUBLIC_V6 and address.is_global


def _within(address: IPv6Address) -> Iterator[IPv4Address]:
    """The address of IPv4 that a gateway would make of one of IPv6."""
    if address in _V6_LOOPBACK:
        return
    if address in _SIX_TO_FOUR:
        yield IPv4Address(address.packed[2:6])
    if any(address in block for block in _ENDING_IN_V4):
        yield IPv4Address(address.packed[12:])


def _kind(address: Address) -> str:
    """What an address that is not public is, in a word."""
    inner = next(_within(address), None) if isinstance(address, IPv6Address) else None
    if inner is not None:
        return f"{_kind(inner)} ({inner})"
    for name in ("loopback", "unspecified", "multicast", "link_local", "reserved", "private"):
        if getattr(address, f"is_{name}"):
            return name.replace("_", "-")
    return "not public"
