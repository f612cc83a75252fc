"""What happened between two control cycles, counted by the fusion loop for the journal."""

from __future__ import annotations

import statistics
import threading
from collections import Counter
from dataclasses import dataclass, field


@dataclass(slots=True)
class Tally:
    """Counts of one control cycle."""

    received: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Payload bytes by (robot, algorithm), late ones included."""
    in_time: Counter[str] = field(default_factory=Counter)
    """Answers that came before their frame's deadline, by robot."""
    missing: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Frames without a chosen robot, by (robot, kind of reason)."""
    latencies_ms: list[float] = field(default_factory=list)
    """From the first query to the fused boxes, one a fused frame."""
    skipped: int = 0
    """Frames that the machine had no time for."""
    failed: int = 0
    """Frames that could not be fused."""
    late_answers: int = 0
    caught_up: int = 0
    """Of the late answers, those that memory has taken up."""
    boxes: int = 0
    """Boxes of the last fused frame."""

    @property
    def fused(self) -> int:
        """Frames that were fused."""
        return len(self.latencies_ms)

    def frame_p50_ms(self) -> float | None:
        """Median latency; None without a fused frame."""
        return statistics.median(self.latencies_ms) if self.latencies_ms else None

    def frame_max_ms(self) -> float | None:
        """Longest latency; None without a fused frame."""
        return max(self.latencies_ms, default=None)


class TallyKeeper:
    """The tally of the running cycle; the fusion loop writes it, the control cycle takes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._current = Tally()

    def take(self) -> Tally:
        """The counts since the last call."""
        with self._lock:
            taken, self._current = self._current, Tally()
            return taken

    def received(self, robot: str, algorithm: str, payload_bytes: int, *, late: bool) -> None:
        """Counts an answer that arrived."""
        with self._lock:
            self._current.received[robot, algorithm] += payload_bytes
            self._current.late_answers += late
            self._current.in_time[robot] += not late

    def caught_up(self, answers: int) -> None:
        """Counts late answers that memory has taken up."""
        with self._lock:
            self._current.caught_up += answers

    def skipped(self, frames: int) -> None:
        """Counts frames that were passed over."""
        with self._lock:
            self._current.skipped += frames

    def failed(self) -> None:
        """Counts a frame that could not be fused."""
        with self._lock:
            self._current.failed += 1

    def fused(self, latency_ms: float, boxes: int, missing: dict[str, str]) -> None:
        """Counts a fused frame; `missing` gives the kind of reason by robot."""
        with self._lock:
            self._current.latencies_ms.append(latency_ms)
            self._current.boxes = boxes
            self._current.missing.update(missing.items())
