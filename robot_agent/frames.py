"""Recent frames of one robot, each with the payloads that were encoded from it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import NamedTuple

from perception.fusion.base import EncodeOptions
from worlds.base import Scan

MAX_PAYLOADS = 8
"""Payloads kept a frame: three algorithms in a few forms; more forms are encoded each time."""

Form = tuple[str, EncodeOptions]


class Encoded(NamedTuple):
    """A payload, and what it took."""

    payload: bytes
    work_ms: float
    """Processor time of the thread that encoded it, also for those who come later."""


class Frame:
    """One scan with its number, its capture time on the robot's clock, and its payloads so far."""

    def __init__(self, scan: Scan, number: int, capture_ns: int) -> None:
        self.scan = scan
        self.number = number
        self.capture_ns = capture_ns
        self._payloads: dict[Form, Future[Encoded]] = {}
        self._lock = threading.Lock()

    def payload(self, form: Form, encode: Callable[[], Encoded]) -> Encoded:
        """The payload of this frame in one form, encoded by the first caller that asks for it.

        Callers that come meanwhile wait for the first one. Raises what `encode` raised.
        """
        with self._lock:
            known = self._payloads.get(form)
            if known is None:
                mine: Future[Encoded] = Future()
                if len(self._payloads) < MAX_PAYLOADS:
                    self._payloads[form] = mine
        if known is not None:
            return known.result()
        try:
            mine.set_result(encode())
        except BaseException as error:
            mine.set_exception(error)
        return mine.result()


class Ring:
    """The most recent frames of one robot; safe to use from several threads."""

    def __init__(self, length: int) -> None:
        self._frames: deque[Frame] = deque(maxlen=length)
        self._lock = threading.Lock()

    def push(self, frame: Frame) -> None:
        """Adds the newest frame; the oldest one leaves a full ring."""
        with self._lock:
            self._frames.append(frame)

    def clear(self) -> None:
        """Forgets all frames."""
        with self._lock:
            self._frames.clear()

    def newest(self) -> Frame | None:
        """The newest frame, None before the first."""
        with self._lock:
            return self._frames[-1] if self._frames else None

    def nearest(self, capture_ns: int) -> Frame | None:
        """The frame captured closest to a time; None before the first."""
        with self._lock:
            frames = list(self._frames)
        return min(frames, key=lambda f: abs(f.capture_ns - capture_ns), default=None)
