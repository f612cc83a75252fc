"""What a run sees of its swarm: what processes say, what they hold in memory, and the journal."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ego_agent.knowledge.journal import CycleRecord, read_journal
from research.chaos.faults.base import Sign
from research.chaos.history import Cycle, DecisionArrival, Frame, Memory
from research.chaos.stage import Stage
from swarm.listening import Handlers, listen
from swarm.messages import Beacon, Decision, Detections, NetState

CONNECT_S = 20.0
LOOK_S = 2.0
KEEP_S = 1.0
OTHER_CLOCK_MS = 600_000.0
"""Clocks that differ by more have been stepped."""
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
MODULES = {
    "swarm.router": "router",
    "network_controller": "controller",
    "llm_gateway": "gateway",
    "options.console": "console",
    "ego_agent": "ego",
    "robot_agent": "robot",
}


class Watch:
    """Hears a swarm from its begin to its end. Handlers run on Zenoh's threads."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self.begun = time.monotonic()
        self.begun_ns = time.time_ns()
        self.decisions: list[DecisionArrival] = []
        self.frames: list[Frame] = []
        self.memory: list[Memory] = []
        self.kept: list[Detections] = []
        """Whole frames, one a second."""
        self._lock = threading.Lock()
        self._newest: dict[str, float] = {}
        """When a decision, a controller's state or a robot's beacon was heard last."""
        self._instance: dict[str, int] = {}
        self._stop = threading.Event()

    def now_s(self) -> float:
        """Seconds since the begin."""
        return time.monotonic() - self.begun

    @property
    def handlers(self) -> Handlers:
        """Who takes which message."""
        return {
            Beacon: self._beacon,
            Decision: self._decision,
            Detections: self._detections,
            NetState: lambda _: self._note("controller"),
        }

    def instance(self, robot: str) -> int | None:
        """Which process spoke last in a robot's name."""
        with self._lock:
            return self._instance.get(robot)

    def is_up(self, sign: Sign, target: str, since_s: float, instance: int | None) -> bool:
        """Whether the sign has come since then; `instance` is the process that was hit."""
        if sign == "none":
            return True
        with self._lock:
            if sign == "anything":
                return max(self._newest.values(), default=-math.inf) > since_s
            place = target if sign in ("beacon", "process") else sign
            if self._newest.get(place, -math.inf) <= since_s:
                return False
            return sign != "process" or self._instance.get(target) != instance

    def look(self) -> None:
        """Notes memory every two seconds, until stopped."""
        while not self._stop.wait(LOOK_S):
            self.memory.extend(_memory(self.now_s()))

    def close(self) -> None:
        """Ends `look`."""
        self._stop.set()

    def _note(self, what: str) -> None:
        with self._lock:
            self._newest[what] = self.now_s()

    def _beacon(self, beacon: Beacon) -> None:
        with self._lock:
            self._newest[beacon.robot] = self.now_s()
            self._instance[beacon.robot] = beacon.instance

    def _decision(self, decision: Decision) -> None:
        if decision.ego != self._stage.spec.ego:
            return
        self._note("decision")
        self.decisions.append(
            DecisionArrival(at_s=self.now_s(), cycle=decision.cycle, decided_ns=decision.decided_ns)
        )

    def _detections(self, frame: Detections) -> None:
        if frame.ego != self._stage.spec.ego:
            return
        if len(self.kept) <= self.now_s() / KEEP_S:
            self.kept.append(frame)
        told_ms = frame.age_ms or 0.0
        late_ms = (time.time_ns() - frame.capture_ns) * 1e-6 - told_ms
        self.frames.append(
            Frame(
                at_s=self.now_s(),
                frame=frame.frame,
                participants=frame.participants,
                sizes=frame.bytes,
                missing=frame.missing_kinds,
                age_ms=told_ms,
                late_ms=late_ms if abs(late_ms) < OTHER_CLOCK_MS else math.nan,
                known_s=max((robot.age_s for robot in frame.known), default=0.0),
            )
        )


@contextmanager
def watching(stage: Stage) -> Iterator[Watch]:
    """A watch that hears the swarm. Raises TransportError where it cannot be reached."""
    watch = Watch(stage)
    state = stage.state
    looker = threading.Thread(target=watch.look, name="memory", daemon=True)
    with listen(state.router, state.spec.swarm, watch.handlers, timeout_s=CONNECT_S):
        looker.start()
        try:
            yield watch
        finally:
            watch.close()
            looker.join()


def cycles(watch: Watch, journal: Path, steps_s: Collection[float]) -> tuple[Cycle, ...]:
    """The journal's lines since the watch began; `steps_s`: by how much the ego's clock may have
    been off. Raises JournalError."""
    found: list[Cycle] = []
    before = 0.0
    for record in read_journal(journal):
        raw_s = (record.started_ns - watch.begun_ns) * 1e-9
        at_s = min((raw_s - step for step in (0.0, *steps_s)), key=lambda at: abs(at - before))
        if at_s < 0.0:
            continue
        before = at_s
        found.append(_cycle(record, at_s))
    return tuple(found)


def _cycle(record: CycleRecord, at_s: float) -> Cycle:
    decided = record.decision
    return Cycle(
        at_s=at_s,
        cycle=record.cycle,
        started_ns=record.started_ns,
        valid=decided.valid,
        cycle_ms=record.latency.cycle_ms,
        cost_bps=8.0 * decided.cost_bytes * (decided.rate_hz or 0.0),
        capacity_bps=record.inputs.capacity_bps,
        participants=decided.participants,
        out={**record.inputs.excluded, **_silent(record)},
    )


def _silent(record: CycleRecord) -> dict[str, str]:
    """Chosen robots that were missing in every frame of a cycle, and why."""
    fused = record.frames.fused
    return {
        robot: f"missing in {fused} frames: {', '.join(sorted(kinds))}"
        for robot, kinds in record.missing.items()
        if fused and sum(kinds.values()) >= fused
    }


def _memory(at_s: float) -> list[Memory]:
    """Of every process of a swarm in this process's namespaces."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        # A process may end while it is looked at.
        with suppress(OSError, ValueError, IndexError):
            words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
            module = MODULES.get(words[words.index("-m") + 1])
            if module is None:
                continue
            name = f"{module}-{_robot(entry)}" if module == "robot" else module
            pages = int((entry / "statm").read_text().split()[1])
            found.append(
                Memory(at_s=at_s, service=name, pid=int(entry.name), rss_bytes=pages * PAGE_BYTES)
            )
    return found


def _robot(entry: Path) -> str:
    environment = dict(
        pair.partition("=")[::2]
        for pair in (entry / "environ").read_bytes().decode(errors="replace").split("\0")
    )
    return str(environment.get("COADAPT_ROBOTS", "?"))
