"""Every action is explained: in the journal, in the log, and in a metric."""

from __future__ import annotations

from typing import Any

from network_controller.journal import Journal
from network_controller.metrics import ControllerMetrics
from network_controller.model import Link
from swarm.log import Logger
from swarm.process import Clock


class Notes:
    """Where the controller says what it did and why."""

    def __init__(
        self, journal: Journal | None, metrics: ControllerMetrics, log: Logger, clock: Clock
    ) -> None:
        self._journal = journal
        self._metrics = metrics
        self._log = log
        self._clock = clock

    def note(self, action: str, reason: str, link: Link | None = None, **facts: Any) -> None:
        """One action, with facts that JSON can hold."""
        if link is not None:
            facts = {"robot": link.robot, "direction": link.direction, **facts}
        self._metrics.actions.labels(action).inc()
        self._log.info(action, reason=reason, **facts)
        if self._journal is not None:
            self._journal.note(self._clock.now_ns(), action, reason, **facts)
            self._show(self._journal)

    def retry(self) -> None:
        """Writes lines that the disk has refused, once it takes them."""
        if self._journal is not None:
            self._journal.retry()
            self._show(self._journal)

    def _show(self, journal: Journal) -> None:
        self._metrics.journal_lost.set(journal.lost + journal.pending)
        self._metrics.journal_pending.set(journal.pending)
