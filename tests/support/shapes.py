"""Clouds of simple things, as a sensor 1.2 m above a floor would see them if it saw all sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes

Cloud = NDArray[np.float32]
FLOOR_M = -1.2
"""Height of the floor in the sensor's frame."""


def box(x: float, y: float, long: float, wide: float, low: float, high: float) -> Cloud:
    """Points on the sides of an upright box, 0.1 m apart; heights over the floor."""
    steps = [np.arange(0.0, size + 1e-6, 0.1) for size in (long, wide, high - low)]
    parts = []
    for along, up in [(steps[0], steps[2])]:
        a, z = np.meshgrid(along, up)
        parts += [
            np.stack([x + a, np.full_like(a, y + side), z + low + FLOOR_M]) for side in (0.0, wide)
        ]
    b, z = np.meshgrid(steps[1], steps[2])
    parts += [
        np.stack([np.full_like(b, x + side), y + b, z + low + FLOOR_M]) for side in (0.0, long)
    ]
    return np.concatenate([part.reshape(3, -1).T for part in parts]).astype(np.float32)


def floor() -> Cloud:
    x, y = np.meshgrid(np.arange(-15.0, 15.0, 0.25), np.arange(-15.0, 15.0, 0.25))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, FLOOR_M)]).astype(np.float32)


def turned(cloud: Cloud, degrees: float) -> Cloud:
    """About its middle."""
    middle, angle = cloud[:, :2].mean(axis=0), np.radians(degrees)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    around = (cloud[:, :2] - middle) @ rotation.T + middle
    return np.column_stack([around, cloud[:, 2]]).astype(np.float32)


def shares_sent(seen: Cloud, sent: Cloud, objects: Boxes, least: int) -> list[float]:
    """Of objects beyond 1 m of which at least so many points were seen: what part of these was
    sent. All in the sensor's frame."""
    shares: list[float] = []
    for center, size in zip(objects.centers, objects.sizes, strict=True):
        there, told = (
            np.count_nonzero(np.hypot(*(cloud[:, :2] - center[:2]).T) < np.hypot(*size[:2]) / 2)
            for cloud in (seen, sent)
        )
        if there >= least and np.hypot(*center[:2]) > 1.0:
            shares.append(told / there)
    return shares
