"""What Prometheus reads of the network controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from prometheus_client import CollectorRegistry, Counter, Gauge

from swarm.messages import LinkState
from swarm.messages.net import Profile
from swarm.metrics import start_at_zero

_LINK = ["robot", "direction"]
_CLASS = [*_LINK, "traffic"]
ACTIONS = (
    *("shaped", "shape_ended", "refused", "expired", "raised", "lowered", "held", "released"),
    *("congested", "relieved", "adopted", "cleared", "ready", "unready", "step_failed"),
    *("link_gone", "shape_lost", "shape_changed", "apply_failed"),
)
"""What `Notes.note` tells."""


class ControllerMetrics:
    """Labels are bounded: robots of one host, two directions, three classes."""

    def __init__(self, registry: CollectorRegistry) -> None:
        def gauge(name: str, text: str, labels: list[str]) -> Gauge:
            return Gauge(f"coadapt_net_{name}", text, labels, registry=registry)

        def counter(name: str, text: str, labels: list[str]) -> Counter:
            return Counter(f"coadapt_net_{name}", text, labels, registry=registry)

        self.capacity = gauge("capacity_bps", "Configured capacity of a link, bit/s.", _LINK)
        self.available = gauge("available_bps", "What fusion can have now, bit/s.", _LINK)
        self.latency = gauge("latency_seconds", "Delay and queueing of fusion now.", _LINK)
        self.level = gauge("level", "Level of the ladder; 0 is the normal state.", _LINK)
        self.guaranteed = gauge("class_rate_bps", "Guaranteed rate of a class, bit/s.", _CLASS)
        self.throughput = gauge("class_throughput_bps", "Sent in the last second, bit/s.", _CLASS)
        self.backlog = gauge("class_backlog_bytes", "Waiting in a class's queue.", _CLASS)
        self.sent = counter("class_sent_bytes_total", "Bytes sent through a class.", _CLASS)
        self.drops = counter("class_drops_total", "Packets that a class dropped.", _CLASS)
        self.overlimits = counter("class_overlimits_total", "Times a class had to wait.", _CLASS)
        self.actions = counter("actions_total", "What the controller did.", ["action"])
        self.requests = counter("requests_total", "Operators' requests.", ["profile", "outcome"])
        self.failures = counter("apply_failures_total", "Shapes that could not be applied.", [])
        self.journal_lost = gauge(
            "journal_lost_lines", "Lines that the disk refuses: waiting, or given up.", []
        )
        self.journal_pending = gauge("journal_pending", "Lines that wait for the disk.", [])
        self.demand = gauge("demand_bytes_per_second", "What an ego needs for Q_min.", ["ego"])
        self.unreachable = gauge("unreachable_seconds", "How long Q_min is out of reach.", ["ego"])
        start_at_zero(self.actions, ACTIONS)
        start_at_zero(self.requests, get_args(Profile), ("done", "refused"))
        self._links: set[tuple[str, str]] = set()
        self._egos: set[str] = set()

    def show(self, states: Iterable[LinkState]) -> None:
        """Takes the links' states; links that are not shaped any more disappear."""
        shown: set[tuple[str, str]] = set()
        for state in states:
            link: tuple[str, str] = (state.robot, state.direction)
            shown.add(link)
            self.capacity.labels(*link).set(state.capacity_bps)
            self.available.labels(*link).set(state.available_bps)
            self.latency.labels(*link).set(state.latency_ms * 1e-3)
            self.level.labels(*link).set(state.level)
            for name, cls in state.classes.items():
                self.guaranteed.labels(*link, name).set(cls.rate_bps)
                self.throughput.labels(*link, name).set(cls.throughput_bps)
                self.backlog.labels(*link, name).set(cls.backlog_bytes)
                for counted in (self.sent, self.drops, self.overlimits):
                    start_at_zero(counted, (state.robot,), (state.direction,), (name,))
        for link in self._links - shown:
            for one in (self.capacity, self.available, self.latency, self.level):
                one.remove(*link)
            for of_class in (self.guaranteed, self.throughput, self.backlog):
                of_class.remove_by_labels({"robot": link[0], "direction": link[1]})
        self._links = shown

    def show_demands(self, demands: dict[str, tuple[int, float]]) -> None:
        """Takes (bytes a second, seconds out of reach) by ego; egos that fell silent disappear."""
        for ego, (needed, unreachable_s) in demands.items():
            self.demand.labels(ego).set(needed)
            self.unreachable.labels(ego).set(unreachable_s)
        for ego in self._egos - set(demands):
            self.demand.remove(ego)
            self.unreachable.remove(ego)
        self._egos = set(demands)
