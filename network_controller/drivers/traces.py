"""What the driver `interface` has put on an interface of the host: written down before it is done,
so that it can be taken away after a crash, and nothing else with it."""

from __future__ import annotations

import fcntl
import json
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import IO

import msgspec

from network_controller.drivers.command import attempt, run, words
from network_controller.drivers.interfaces import index_of
from swarm.errors import NetworkError
from swarm.files import write_whole

MARK = "coadapt-interface "
"""How the alias of our `ifb` devices begins, before the interface that they queue for."""
WAYS = ("egress", "ingress")
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_PREFERENCE = re.compile(r"^filter .*?\bpref (\d+) ")
_REDIRECT = re.compile(r"Redirect to device (\S+?)\)")


class _Trace(msgspec.Struct, frozen=True):
    """That the qdisc `clsact` of an interface is ours."""

    interface: str
    index: int
    boot: str
    """What the kernel has is gone after the next start of the machine."""


class Traces:
    """The file that tells of one controller's traces. While it is open, no other one has it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock: IO[str] | None = None

    def open(self) -> None:
        """Takes the file, and takes away what an earlier controller left.

        Raises NetworkError where another controller has it, or where something cannot be removed.
        """
        if self._lock is not None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            lock = open(f"{self._path}.lock", "a")  # noqa: SIM115
        except OSError as error:
            raise NetworkError(f"{self._path} cannot be written: {error}") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.remove()
        except OSError as error:
            lock.close()
            raise NetworkError(
                f"another controller shapes by {self._path}: end it, or name another file with "
                "COADAPT_INTERFACE_STATE"
            ) from error
        except NetworkError:
            lock.close()
            raise
        self._lock = lock

    def begin(self, interface: str) -> None:
        """Writes down that `clsact` of an interface is ours from now on, and makes it. Raises
        NetworkError."""
        trace = _Trace(interface, index_of(interface), _boot())
        try:
            write_whole(self._path, msgspec.json.encode(trace))
        except OSError as error:
            raise NetworkError(f"{self._path} cannot be written: {error}") from error
        run("tc", "qdisc", "add", "dev", interface, "clsact")

    def began(self, interface: str) -> bool:
        """Whether this very interface has a `clsact` that is ours."""
        if self._read() != _Trace(interface, index_of(interface), _boot()):
            return False
        return "qdisc clsact" in attempt("tc", "qdisc", "show", "dev", interface).stdout

    def remove(self) -> None:
        """Takes away what is written down. Raises NetworkError where something stays."""
        trace = self._read()
        if trace is None:
            return
        if trace.boot == _boot():
            devices = ours(trace.interface)
            if index_of(trace.interface) == trace.index:
                _unhook(trace.interface, devices)
            # Only now: what a redirection sends to an `ifb` that is no more is lost.
            for device in devices:
                done = attempt("ip", "link", "del", device)
                if done.returncode != 0 and index_of(device):
                    raise NetworkError(f"ip does not remove {device}: {words(done)}")
        self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Lets others have the file."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _read(self) -> _Trace | None:
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=_Trace)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as error:
            raise NetworkError(
                f"{self._path}, what an earlier controller has put on an interface, cannot be "
                f"read: {error}; look at `tc qdisc` and remove the file"
            ) from error


def alias_of(interface: str, link: str) -> str:
    """The alias of the `ifb` device that queues one link of an interface."""
    return f"{MARK}{interface} {link}"


def ours(interface: str) -> list[str]:
    """The `ifb` devices that queue for an interface."""
    shown = json.loads(run("ip", "-j", "link", "show", "type", "ifb") or "[]")
    return [
        one["ifname"]
        for one in shown
        if str(one.get("ifalias", "")).startswith(alias_of(interface, ""))
    ]


def _unhook(interface: str, devices: list[str]) -> None:
    """Removes our redirections, and `clsact` unless somebody else uses it by now."""
    others = False
    for way in WAYS:
        targets = _targets(attempt("tc", "filter", "show", "dev", interface, way).stdout)
        for number, found in targets.items():
            if found and found <= set(devices):
                run("tc", "filter", "del", "dev", interface, way, "pref", number)
            else:
                others = True
    present = "qdisc clsact" in attempt("tc", "qdisc", "show", "dev", interface).stdout
    if present and not others:
        run("tc", "qdisc", "del", "dev", interface, "clsact")


def _targets(shown: str) -> dict[str, set[str]]:
    """The devices to which filters redirect, by their preference, in what `tc` shows of them."""
    found: dict[str, set[str]] = {}
    number = ""
    for line in shown.splitlines():
        if match := _PREFERENCE.match(line):
            number = match[1]
            found.setdefault(number, set())
        elif (match := _REDIRECT.search(line)) and number:
            found[number].add(match[1])
    return found


def _boot() -> str:
    with suppress(OSError):
        return _BOOT.read_text().strip()
    return os.uname().version
