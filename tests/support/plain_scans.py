"""A folder of plain scans, as somebody without rosbags has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def plain_scans(folder: Path) -> Path:
    """A folder of two robots' scans and poses."""
    for x, robot in enumerate(("R1", "R2")):
        (folder / robot).mkdir(parents=True)
        points = np.random.default_rng(x).uniform(-20, 20, (500, 3)).astype(np.float32)
        for frame in range(3):
            np.save(folder / robot / f"{frame}.npy", points)
        pose = f"1 0 0 {5 * x} 0 1 0 0 0 0 1 1"
        (folder / robot / "poses.txt").write_text("\n".join([pose] * 3) + "\n")
    return folder
