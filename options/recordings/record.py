"""Records a running swarm until the time is up, someone stops it, or the swarm is gone."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from deploy.state import State
from options.recordings.format import Points
from options.recordings.listen import AWAY_S, Listener
from options.recordings.outlet import Outlet
from options.recordings.recorder import Recorder
from options.recordings.scans import Scans
from options.recordings.sink import Sink
from options.ros.fused import Teller
from swarm.errors import RecordingError, TransportError

CONNECT_S = 5.0
LOOK_S = 0.25
PROGRESS_S = 5.0
FINISH_S = 5.0
"""For scans of what had come by the end."""
_UNWRITABLE = "the file cannot be written"
BUSY = 400
"""Messages waiting, above which scans are left out: what is said matters more than what is seen."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to record. Everything is checked before anything starts."""

    output: Path | None
    """None writes no file: the swarm is shown live only."""
    points: Points = "all"
    whole: bool = False
    """Every point for viewers; else some, and scans as ranges where they can be that."""
    truth: bool = True
    """True boxes, where scans are recorded; a simulated world shoots all robots' scans for them."""
    rate_hz: float | None = None
    """Frames a second with scans; None takes every fused frame."""
    seconds: float | None = None
    """None goes on until it is stopped."""
    live_port: int | None = None
    """Where Foxglove may connect; None serves nothing."""
    ros: bool = False
    """Fused objects as ROS 2 messages, too."""


@dataclass(frozen=True, slots=True)
class Result:
    """What was recorded."""

    path: Path | None
    bytes: int
    seconds: float
    fused: int
    """Fused frames of the ego."""
    frames: int
    """Frames with scans."""
    left_out: int
    lost: int
    """Messages that there was no time for."""
    ended: str
    """Why it ended."""


def record(
    state: State,
    wanted: Wanted,
    stop: threading.Event,
    say: Callable[[str], None],
    gone: Callable[[], bool],
) -> Result:
    """Records a swarm.

    Args:
        state: of the running swarm.
        wanted: what to record.
        stop: ends the recording when it is set.
        say: is given lines of progress.
        gone: whether the swarm was taken down.

    The file is whole whatever ends the recording. Raises RecordingError when it cannot begin, or
    the file could not be written to its end; TransportError when the router does not answer; and
    WorldError when the swarm's world cannot be opened here. Then there is no file, or one that can
    be read up to where it is cut off.
    """
    scans = None
    if wanted.points != "none":
        scans = Scans(state.spec, wanted.points, wanted.rate_hz, wanted.truth, whole=wanted.whole)
    sink = None if wanted.output is None else Sink(wanted.output)
    try:
        outlet = Outlet(sink, wanted.live_port, f"coadapt {state.spec.swarm}")
    except BaseException:
        if sink is not None:
            sink.discard()
        raise
    begun = time.monotonic()
    try:
        listener = Listener(state, CONNECT_S)
    except TransportError:
        outlet.close()
        if sink is not None:
            sink.discard()
        raise
    if outlet.port is not None:
        say(f"live: open Foxglove, and connect to ws://127.0.0.1:{outlet.port}")
    try:
        with listener:
            ros = Teller(state.spec.ego) if wanted.ros else None
            recorder = Recorder(state.spec, outlet, scans, wanted.points, time.time_ns(), ros)
            ended = _listen(listener, recorder, sink, wanted.seconds, stop, say, gone)
    finally:
        outlet.close()
    if sink is not None and sink.error:
        raise RecordingError(
            f"recording {sink.path} could not be written to its end: {sink.error}; the first "
            f"{sink.bytes} bytes can be replayed"
        )
    return Result(
        path=wanted.output,
        bytes=0 if sink is None else sink.bytes,
        seconds=time.monotonic() - begun,
        fused=recorder.fused,
        frames=recorder.frames,
        left_out=recorder.left_out,
        lost=listener.lost,
        ended=ended,
    )


def _listen(
    listener: Listener,
    recorder: Recorder,
    sink: Sink | None,
    seconds: float | None,
    stop: threading.Event,
    say: Callable[[str], None],
    gone: Callable[[], bool],
) -> str:
    """Records until something ends it; returns what."""
    begun = looked = told = time.monotonic()
    ended = ""
    while not ended:
        heard = listener.next(LOOK_S)
        now = time.monotonic()
        if heard is not None:
            recorder.take(heard, hurry=listener.waiting() > BUSY)
        if sink is not None and sink.error:
            return _UNWRITABLE
        if now - told >= PROGRESS_S:
            told = now
            recorder.flush()
            say(f"  {now - begun:.0f} s: {_progress(recorder, sink)}")
        if stop.is_set():
            ended = "stopped"
        elif seconds is not None and now - begun >= seconds:
            ended = f"{seconds:g} s are over"
        elif now - looked >= LOOK_S:
            looked = now
            ended = _trouble(listener, sink, gone)
    return _finish(listener, recorder, sink) or ended


def _finish(listener: Listener, recorder: Recorder, sink: Sink | None) -> str:
    """Writes what has come so far, but not what comes meanwhile; returns why it could not."""
    ended_at = time.monotonic()
    for waiting in range(listener.waiting(), 0, -1):
        heard = listener.next(0.0)
        if heard is not None:
            late = time.monotonic() - ended_at > FINISH_S
            recorder.take(heard, hurry=late or waiting > BUSY)
        if sink is not None and sink.error:
            return _UNWRITABLE
    return ""


def _trouble(listener: Listener, sink: Sink | None, gone: Callable[[], bool]) -> str:
    if gone():
        return "the swarm was taken down"
    if listener.away_s() > AWAY_S:
        return f"the swarm's router has been away for {AWAY_S:.0f} s"
    return (sink.nearly_full() or "") if sink is not None else ""


def _progress(recorder: Recorder, sink: Sink | None) -> str:
    size = "" if sink is None else f", {sink.bytes / 1e6:.1f} MB"
    left_out = f", {recorder.left_out} without scans" if recorder.left_out else ""
    return f"{recorder.fused} fused frames, {recorder.frames} with scans{left_out}{size}"
