"""Making links what they should be: only differences are applied, and every failure is told."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress

from network_controller.drivers.base import Driver
from network_controller.model import ClassShape, Link, LinkReading, LinkShape
from swarm.errors import LinkGoneError, NetworkError

TOLERANCE = 0.01
"""`tc` shows rates rounded."""


class Enforcer:
    """Knows what it has applied to which link."""

    def __init__(self, driver: Driver, on_event: Callable[[str, str, Link], None]) -> None:
        """`on_event(action, reason, link)` hears of what happens to links."""
        self._driver = driver
        self._on_event = on_event
        self._applied: dict[Link, LinkShape] = {}
        self._touched: set[Link] = set()
        """Links that may carry a shape, also one that is not as it should be."""
        self._renewed: Link | None = None
        self.changes = 0
        """How often a link was given another shape, or none."""
        self.problems: dict[Link, str] = {}
        """Links that are not as they should be, and why."""

    def shape_of(self, link: Link) -> LinkShape | None:
        """What a link was last shaped to."""
        return self._applied.get(link)

    def links(self) -> frozenset[Link]:
        """The links that are shaped."""
        return frozenset(self._applied)

    def adopt(self, links: Collection[Link]) -> None:
        """Takes over links that an earlier controller shaped: the next `reconcile` shapes them as
        they should be, or clears them."""
        self._touched.update(links)

    def apply(self, link: Link, shape: LinkShape | None) -> None:
        """Shapes a link, or clears it for None. Raises NetworkError; it is then as before."""
        if shape is None:
            self._driver.clear(link)
            self.changes += 1
            self._applied.pop(link, None)
            self._touched.discard(link)
        elif self._applied.get(link) != shape:
            self._touched.add(link)
            self._driver.apply(link, shape)
            self.changes += 1
            self._applied[link] = shape
        self.problems.pop(link, None)

    def change(self, shapes: Mapping[Link, LinkShape | None]) -> None:
        """Applies several shapes, all or none. Raises the NetworkError of the first that fails."""
        before = {link: self._applied.get(link) for link in shapes}
        done: list[Link] = []
        try:
            for link, shape in shapes.items():
                self.apply(link, shape)
                done.append(link)
        except NetworkError:
            for link in reversed(done):
                with suppress(NetworkError):
                    self.apply(link, before[link])
            raise

    def reconcile(self, wanted: Mapping[Link, LinkShape]) -> None:
        """Brings all links to what is wanted. What fails is tried again the next time."""
        for link in self._touched - set(wanted):
            self._try(link, None)
        for link in self.problems.keys() - self._touched - set(wanted):
            del self.problems[link]
        for link, shape in wanted.items():
            if self._applied.get(link) != shape or link in self.problems:
                self._try(link, shape)

    def check(self, readings: Mapping[Link, LinkReading], present: Collection[str]) -> None:
        """Compares what was applied with what the kernel has; what differs is applied again by
        the next `reconcile`. `present` are the robots whose links are there."""
        for link in self.links():
            reading, shape = readings.get(link), self._applied[link]
            if reading is not None and _alike(reading, shape):
                continue
            del self._applied[link]
            if link.robot not in present:
                self._on_event("link_gone", "its robot has left this host", link)
            elif reading is None:
                self._on_event("shape_lost", "its interface is a new one, or was cleared", link)
            else:
                self._on_event("shape_changed", "somebody else changed it", link)

    def renew(self) -> None:
        """Applies one link again, the next one with each call: readings do not show that a filter
        is missing, and the class of a mark would stay empty for good."""
        if not self._applied:
            return
        links = sorted(self._applied)
        later = (link for link in links if self._renewed is not None and link > self._renewed)
        self._renewed = next(later, links[0])
        told = self.changes
        self._try(self._renewed, self._applied.pop(self._renewed))
        self.changes = told  # The same shape again is nothing to tell of.

    def _try(self, link: Link, shape: LinkShape | None) -> None:
        try:
            self.apply(link, shape)
        except LinkGoneError as error:
            self._applied.pop(link, None)
            self._touched.discard(link)
            self._tell(link, "link_gone", str(error))
        except NetworkError as error:
            self._tell(link, "apply_failed", str(error))

    def _tell(self, link: Link, action: str, why: str) -> None:
        if self.problems.get(link) != why:
            self._on_event(action, why, link)
        self.problems[link] = why


def _alike(reading: LinkReading, shape: LinkShape) -> bool:
    """The kernel has the shape, but for rounding."""

    def near(a: int, b: int) -> bool:
        return abs(a - b) <= max(8, TOLERANCE * b)

    def same(a: ClassShape, b: ClassShape) -> bool:
        rates = near(a.rate_bps, b.rate_bps) and near(a.ceil_bps, b.ceil_bps)
        return rates and a.priority == b.priority

    return (
        near(reading.capacity_bps, shape.capacity_bps)
        and near(reading.cell_bps, shape.cell_bps)
        and abs(reading.delay_ms - shape.delay_ms) <= max(0.01, TOLERANCE * shape.delay_ms)
        and abs(reading.loss - shape.loss) <= max(1e-4, TOLERANCE * shape.loss)
        and all(
            traffic in reading.classes and same(reading.classes[traffic].shape, wanted)
            for traffic, wanted in shape.classes.items()
        )
    )
