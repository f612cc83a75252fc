"""When each scan of a bag was taken, kept between processes.

Robots' recorders mix scans up, so that all stamps are needed before the first scan can be shown;
of a compressed bag that means to unpack it whole, in each process of a swarm.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from options.bags.recording import Messages
from options.ros.messages import STAMP_BYTES, read_stamp
from swarm.files import write_whole
from worlds.clouds.npy import read_npy

MANY = 1000
"""Fewer scans' stamps are read as fast as they are looked up."""


def read_stamps(clouds: Messages) -> NDArray[np.int64]:
    """Of each scan, int64 (N,) nanoseconds: its header's stamp, or else when it was recorded.

    Those of MANY scans are kept in a file, for as long as the bag's files stay as they are; where
    it cannot be written, or is damaged, they are read again. Raises WorldError when the bag cannot
    be read.
    """
    kept = _place(clouds) if len(clouds) >= MANY else None
    stamps = None if kept is None else _load(kept, len(clouds))
    if stamps is None:
        stamps = np.array(
            [
                clouds.decode(index, read_stamp, STAMP_BYTES) or int(recorded_ns)
                for index, recorded_ns in enumerate(clouds.times_ns)
            ],
            dtype=np.int64,
        )
        if kept is not None:
            _keep(kept, stamps)
    return stamps


def _place(clouds: Messages) -> Path | None:
    """The file for the bag as it is now; None where there is no place for one."""
    key = hashlib.sha256(clouds.times_ns.tobytes())
    key.update(clouds.topic.encode())
    try:
        for path in clouds.files:
            facts = path.stat()
            key.update(f"{path.resolve()} {facts.st_size} {facts.st_mtime_ns}\n".encode())
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except (OSError, RuntimeError):
        return None
    return Path(home) / "coadapt" / "stamps" / f"{key.hexdigest()}.npy"


def _load(path: Path, count: int) -> NDArray[np.int64] | None:
    try:
        found: NDArray[np.int64] = read_npy(path)
    except (OSError, ValueError):
        return None
    return found if found.dtype == np.int64 and found.shape == (count,) else None


def _keep(path: Path, stamps: NDArray[np.int64]) -> None:
    buffer = io.BytesIO()
    np.save(buffer, stamps, allow_pickle=False)
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, buffer.getvalue())
