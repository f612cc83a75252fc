"""Whether a detector suits scans: they are compared with those that it was trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.detector.config import DetectorConfig, configuration, configurations
from swarm.geometry import Points

MIN_POINTS = 200
"""What fewer points are like cannot be told."""
GROUND_DISTANCES_M = (2.0, 30.0)
"""Between them, seen from above, the ground is looked for: nearer, there is the robot itself."""
BIN_M = 0.1


@dataclass(frozen=True, slots=True)
class ScanProfile:
    """What scans are like."""

    points: int
    """Median number of points of a scan."""
    reach_m: float
    """Within which 99 % of the points lie, seen from above."""
    height_m: float | None
    """Of the sensor over the ground; None where no ground is seen."""

    def __str__(self) -> str:
        height = "no ground seen" if self.height_m is None else f"{self.height_m:.1f} m over ground"
        return f"{self.points} points a scan, {height}, reach {self.reach_m:.0f} m"


def profile(scans: Sequence[Points]) -> ScanProfile | None:
    """What scans (N, 3) in their sensors' frames, z up, are like; None where there is too little
    in them."""
    scans = [scan for scan in scans if len(scan) >= MIN_POINTS]
    if not scans:
        return None
    heights = [height for scan in scans if (height := _height(scan)) is not None]
    return ScanProfile(
        points=int(np.median([len(scan) for scan in scans])),
        reach_m=float(np.median([np.percentile(_distances(scan), 99) for scan in scans])),
        height_m=float(np.median(heights)) if heights else None,
    )


def misfits(seen: ScanProfile, config: DetectorConfig) -> tuple[str, ...]:
    """Why a detector does not suit such scans; nothing where it does."""
    sensor, found = config.sensor, []
    low, high = sensor.heights_m
    if seen.height_m is not None and not low <= seen.height_m <= high:
        found.append(
            f"the sensors stand {seen.height_m:.1f} m over the ground, it knows {low} to {high} m"
        )
    near, far = sensor.reaches_m
    if not near <= seen.reach_m <= far:
        found.append(f"the scans reach {seen.reach_m:.0f} m, it knows {near:.0f} to {far:.0f} m")
    if seen.points < sensor.min_points:
        found.append(f"a scan has {seen.points} points, it needs {sensor.min_points}")
    return tuple(found)


def best_detector(seen: ScanProfile) -> str:
    """The name of the detector that suits such scans best: by the number of reasons against it,
    then by how far its sensors' height is off."""

    def against(name: str) -> tuple[int, float]:
        config = configuration(name)
        off = 0.0 if seen.height_m is None else abs(seen.height_m - config.sensor.height_m)
        return len(misfits(seen, config)), off

    return min(configurations(), key=against)


def _height(scan: Points) -> float | None:
    """By the densest layer of what lies below the sensor."""
    distances = _distances(scan)
    near, far = GROUND_DISTANCES_M
    below = scan[(distances > near) & (distances < far) & (scan[:, 2] < -BIN_M), 2]
    if len(below) < MIN_POINTS / 4:
        return None
    layers, counts = np.unique(np.round(below / BIN_M), return_counts=True)
    densest = layers[counts.argmax()] * BIN_M
    return -float(np.median(below[np.abs(below - densest) < 1.5 * BIN_M]))


def _distances(scan: Points) -> Points:
    return np.hypot(scan[:, 0], scan[:, 1])
