"""What links should be: the swarm's own shape, and what operators put over it for good or a while.

Three layers lie over each other on every link: what the swarm was started with, an operator's
shape that stays, an operator's shape that expires. The top one counts; when it goes, the one
below it counts again, so that no shape that ends ever cuts traffic off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import msgspec

from network_controller.model import Link
from network_controller.profiles import Fixed, Profile, Series, Shift
from swarm.errors import NetworkError
from swarm.files import write_whole
from swarm.messages import MAX_RATE_BPS, MIN_RATE_BPS, Direction

Layer = Literal["start", "stays", "expires"]
LAYERS: tuple[Layer, ...] = ("start", "stays", "expires")
"""From the bottom to the top."""
TRACE_FLOOR_BPS = 8_000
"""A recorded outage is this slow: HTB knows no rate of 0."""
_NS = 1e9


class Wish(msgspec.Struct, frozen=True, kw_only=True):
    """One layer of one direction of one robot's link."""

    robot: str
    direction: Direction
    layer: Layer
    kind: Literal["rate", "shift", "trace"]
    operator: str
    since_ns: int
    until_ns: int = 0
    """0: never."""
    rates_bps: tuple[int, ...] = ()
    interval_s: float = 1.0
    time_scale: float = 1.0
    delay_ms: float = 0.0
    loss: float = 0.0

    @property
    def link(self) -> Link:
        """The link that it is for."""
        return Link(self.robot, self.direction)

    def profile(self) -> Profile:
        """The capacity over time, from `since_ns` on."""
        if self.kind == "shift":
            return Shift(self.time_scale)
        if self.kind == "trace":
            return Series(self.rates_bps, self.interval_s, self.time_scale)
        return Fixed(self.rates_bps[0])

    def rate_bps(self, now_ns: int) -> int:
        """The capacity now, as a link can have it."""
        elapsed_s = max(0.0, (now_ns - self.since_ns) / _NS)
        floor = TRACE_FLOOR_BPS if self.kind == "trace" else MIN_RATE_BPS
        return min(MAX_RATE_BPS, max(floor, round(self.profile().rate_bps(elapsed_s))))

    def next_change_ns(self, now_ns: int) -> float:
        """When it has to be looked at again; infinity: never."""
        elapsed_s = max(0.0, (now_ns - self.since_ns) / _NS)
        change_s = self.profile().next_change_s(elapsed_s)
        change_ns = math.inf if change_s is None else self.since_ns + change_s * _NS
        return min(change_ns, self.until_ns or math.inf)


class _Saved(msgspec.Struct, frozen=True):
    revision: int
    wishes: tuple[Wish, ...]


class Wishes:
    """All layers of all links. Operators' layers are kept in a file over restarts."""

    def __init__(self, path: Path | None, now_ns: int) -> None:
        """Reads what an earlier controller kept, without what has expired since.

        Raises NetworkError when the file is there and cannot be read.
        """
        self.revision = 0
        self._path = path
        self._layers: dict[Link, dict[Layer, Wish]] = {}
        if path is None or not path.exists():
            return
        try:
            saved = msgspec.json.decode(path.read_bytes(), type=_Saved)
        except (OSError, msgspec.DecodeError) as error:
            raise NetworkError(
                f"shapes kept in {str(path)!r} cannot be read: {error}; remove the file to forget "
                "them"
            ) from error
        self.revision = saved.revision
        for wish in saved.wishes:
            if not wish.until_ns or wish.until_ns > now_ns:
                self._layers.setdefault(wish.link, {})[wish.layer] = wish

    def __iter__(self) -> Iterator[Wish]:
        """The wishes that count: the top layer of each link."""
        for layers in self._layers.values():
            yield layers[_top(layers)]

    def get(self, link: Link) -> Wish | None:
        """The wish that counts for a link."""
        layers = self._layers.get(link)
        return layers[_top(layers)] if layers else None

    def copy(self) -> Mapping[Link, Mapping[Layer, Wish]]:
        """All layers, to be given back to `restore` when a change cannot be carried out."""
        return {link: dict(layers) for link, layers in self._layers.items()}

    def restore(self, layers: Mapping[Link, Mapping[Layer, Wish]]) -> None:
        """Takes back every change since `copy`."""
        self._layers = {link: dict(by_layer) for link, by_layer in layers.items()}

    def put(self, wish: Wish) -> None:
        """Takes a wish in. A shape that stays also ends the one over it that expires."""
        layers = self._layers.setdefault(wish.link, {})
        layers[wish.layer] = wish
        if wish.layer == "stays":
            layers.pop("expires", None)

    def drop(self, link: Link) -> None:
        """Removes what operators put on a link; the swarm's own shape counts again."""
        layers = self._layers.get(link, {})
        for layer in ("stays", "expires"):
            layers.pop(layer, None)
        if not layers:
            self._layers.pop(link, None)

    def expire(self, now_ns: int) -> tuple[Wish, ...]:
        """Removes what has expired, and returns it."""
        over = [
            wish
            for layers in self._layers.values()
            for wish in layers.values()
            if wish.until_ns and wish.until_ns <= now_ns
        ]
        for wish in over:
            layers = self._layers[wish.link]
            del layers[wish.layer]
            if not layers:
                del self._layers[wish.link]
        return tuple(over)

    def changed(self) -> None:
        """Counts a change by an operator or by expiry, and keeps it.

        Raises NetworkError when the file cannot be written.
        """
        if self._path is None:
            self.revision += 1
            return
        kept = tuple(
            wish
            for layers in self._layers.values()
            for layer, wish in layers.items()
            if layer != "start"
        )
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, msgspec.json.encode(_Saved(self.revision + 1, kept)))
        except OSError as error:
            raise NetworkError(f"shapes cannot be kept in {str(self._path)!r}: {error}") from error
        self.revision += 1


def _top(layers: Mapping[Layer, Wish]) -> Layer:
    return next(layer for layer in reversed(LAYERS) if layer in layers)
