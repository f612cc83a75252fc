"""The ego of `research.benchmarks.roundtrip`: the real one, whose frames are noted for a while.

`python -m research.benchmarks.roundtrip_ego FILE SECONDS` takes the settings of `ego_agent` and
ends by itself; FILE then holds a JSON list with an object a frame.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

from ego_agent.__main__ import run
from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.settings import load_settings
from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from sensing.opening import open_world_of
from swarm.memory import keep_freed_memory
from swarm.process import leave, stop_on_signals

WARM_UP_S = 8.0
"""From the first frame with another robot on: the first pass through each layer takes longer."""
DECODED = 40
"""Frames whose payloads are decoded once more on their own."""


class Notes:
    """The frames of `seconds`, once the swarm is warm."""

    def __init__(self, seconds: float, stop: threading.Event) -> None:
        self.frames: list[dict[str, Any]] = []
        self.kept: list[FrameResult] = []
        self._seconds = seconds
        self._stop = stop
        self._from: float | None = None

    def take(self, result: FrameResult) -> None:
        """Notes a frame; sets the stop event with the last one."""
        now, done = time.monotonic(), result.round
        if self._from is None:
            if not done.contributions:
                return
            self._from = now + WARM_UP_S
        if now < self._from:
            return
        if now > self._from + self._seconds:
            self._stop.set()
            return
        self.frames.append(
            {
                "at_s": now - self._from,
                "frame": result.own.frame,
                "latency_ms": result.latency_ms,
                "wait_ms": result.wait_ms,
                "add_ms": result.add_ms,
                "fuse_ms": result.fuse_ms,
                "age_ms": (time.time_ns() - result.own.capture_ns) * 1e-6,
                "due": sorted(done.questions),
                "participants": result.participants[1:],
                "missing": result.missing_kinds(),
                "bytes": sum(done.bytes.values()),
                "encode_ms": dict(done.encode_ms),
            }
        )
        asked = {question.algorithm for question in done.questions.values()}
        if len(self.kept) < DECODED and asked == {"early"}:
            self.kept.append(result)

    def note_decoding(self) -> None:
        """Adds the processor time of decoding a frame's payloads, measured again on its own."""
        for frame, result in zip(self.frames, self.kept, strict=False):
            begun = time.thread_time()
            for contribution in result.round.contributions:
                decode_points(take_outline(contribution.payload)[0])
            frame["decode_cpu_ms"] = (time.thread_time() - begun) * 1e3


def main() -> None:
    """Runs the ego until enough was noted."""
    keep_freed_memory()
    path, seconds = Path(sys.argv[1]), float(sys.argv[2])
    stop = stop_on_signals()
    settings = load_settings()
    notes = Notes(seconds, stop)
    with open_world_of(settings, "roundtrip", settings.ego) as world:
        run(settings, world, stop, notes.take)
    notes.note_decoding()
    path.write_text(json.dumps(notes.frames))


if __name__ == "__main__":
    main()
    leave(0)
