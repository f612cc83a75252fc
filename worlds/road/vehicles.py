"""Vehicles of many shapes: a body lofted along its length, wheels, mirrors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worlds.road.meshes import Floats, Mesh, boxes, cylinder, join, loft

Profile = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Model:
    """A kind of vehicle."""

    share: float
    """How often it is met."""
    length: tuple[float, float]
    width: tuple[float, float]
    """Mirrors included, as in CARLA's boxes."""
    height: tuple[float, float]
    top: Profile
    """Upper outline from rear to front: (place along the length, -0.5 to 0.5; share of height)."""
    belt: float
    """Lower edge of the windows, share of the height."""
    roof: float
    """Width of the roof, share of the body's."""
    floor: float
    """Height of the under-body, metres."""


_SEDAN: Profile = (
    (-0.5, 0.42), (-0.495, 0.6), (-0.47, 0.7), (-0.34, 0.74), (-0.17, 0.96), (-0.05, 1.0),
    (0.06, 0.98), (0.24, 0.69), (0.4, 0.61), (0.47, 0.52), (0.495, 0.42), (0.5, 0.34),
)  # fmt: skip
_RECORDING: Profile = (
    (-0.5, 0.5), (-0.495, 0.66), (-0.47, 0.77), (-0.35, 0.78), (-0.2, 0.93), (-0.07, 1.0),
    (0.02, 0.98), (0.22, 0.72), (0.4, 0.66), (0.46, 0.6), (0.49, 0.48), (0.5, 0.34),
)  # fmt: skip
_HATCHBACK: Profile = (
    (-0.5, 0.35), (-0.485, 0.55), (-0.44, 0.72), (-0.36, 0.95), (-0.2, 1.0), (-0.02, 1.0),
    (0.09, 0.95), (0.26, 0.67), (0.4, 0.59), (0.47, 0.5), (0.495, 0.4), (0.5, 0.32),
)  # fmt: skip
_SPORTS: Profile = (
    (-0.5, 0.45), (-0.49, 0.66), (-0.46, 0.74), (-0.36, 0.78), (-0.16, 0.95), (-0.04, 1.0),
    (0.03, 0.97), (0.2, 0.7), (0.36, 0.62), (0.45, 0.53), (0.49, 0.42), (0.5, 0.32),
)  # fmt: skip
_BOXY: Profile = (
    (-0.5, 0.3), (-0.49, 0.5), (-0.47, 0.6), (-0.45, 0.96), (-0.3, 1.0), (0.05, 1.0),
    (0.1, 0.96), (0.17, 0.68), (0.35, 0.65), (0.45, 0.62), (0.48, 0.5), (0.5, 0.35),
)  # fmt: skip
_VAN: Profile = (
    (-0.5, 0.25), (-0.495, 0.6), (-0.48, 0.95), (-0.4, 0.99), (0.0, 1.0), (0.15, 0.98),
    (0.25, 0.9), (0.38, 0.57), (0.44, 0.49), (0.48, 0.4), (0.495, 0.3), (0.5, 0.22),
)  # fmt: skip
_PICKUP: Profile = (
    (-0.5, 0.4), (-0.495, 0.6), (-0.485, 0.62), (-0.14, 0.62), (-0.12, 0.93), (-0.03, 1.0),
    (0.08, 0.98), (0.2, 0.7), (0.38, 0.64), (0.46, 0.58), (0.49, 0.45), (0.5, 0.33),
)  # fmt: skip
_TRUCK: Profile = (
    (-0.5, 0.25), (-0.498, 0.6), (-0.495, 0.98), (0.0, 1.0), (0.15, 0.99), (0.17, 0.82),
    (0.3, 0.8), (0.38, 0.72), (0.44, 0.45), (0.48, 0.38), (0.495, 0.3), (0.5, 0.2),
)  # fmt: skip

# Lengths, widths and heights span those of passenger cars and light trucks on the market.
MODELS = {
    "sedan": Model(0.24, (4.4, 5.4), (1.9, 2.2), (1.38, 1.55), _SEDAN, 0.64, 0.63, 0.2),
    # Never drawn: OPV2V's recording car, by the points that its own scans show of it.
    "recording": Model(0.0, (4.9, 4.9), (2.13, 2.13), (1.51, 1.51), _RECORDING, 0.6, 0.62, 0.2),
    "hatchback": Model(0.26, (3.6, 4.4), (1.75, 2.05), (1.42, 1.65), _HATCHBACK, 0.6, 0.66, 0.19),
    "suv": Model(0.16, (4.2, 5.0), (1.9, 2.25), (1.6, 1.85), _HATCHBACK, 0.62, 0.7, 0.25),
    "sports": Model(0.12, (4.1, 5.4), (1.85, 2.1), (1.2, 1.42), _SPORTS, 0.66, 0.6, 0.16),
    "boxy": Model(0.08, (3.7, 4.8), (1.8, 2.1), (1.7, 2.0), _BOXY, 0.6, 0.83, 0.32),
    "van": Model(0.06, (4.5, 6.2), (1.95, 2.3), (1.8, 2.7), _VAN, 0.55, 0.88, 0.24),
    "pickup": Model(0.05, (5.0, 6.2), (1.95, 2.3), (1.7, 1.95), _PICKUP, 0.6, 0.72, 0.34),
    "truck": Model(0.03, (5.2, 6.8), (2.1, 2.5), (2.2, 2.9), _TRUCK, 0.55, 0.94, 0.4),
}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A body in its own frame: x forward, y left, z up from the ground, middle at x = y = 0."""

    model: str
    size: tuple[float, float, float]
    """Length, width, height of its box, which stands on the ground."""
    mesh: Mesh


def draw_vehicle(rng: np.random.Generator) -> Vehicle:
    """A vehicle of a random model, shape and size."""
    names = list(MODELS)
    name = names[int(rng.choice(len(names), p=[MODELS[n].share for n in names]))]
    model = MODELS[name]
    # Long cars tend to be wide.
    scale = rng.random()
    size = [
        low + (high - low) * float(np.clip(scale + rng.normal(0.0, 0.2), 0.0, 1.0))
        for low, high in (model.length, model.width, model.height)
    ]
    return _build(name, (size[0], size[1], size[2]), rng)


def recording_car() -> Vehicle:
    """The car that carries a sensor: a sedan of the size of OPV2V's recording cars."""
    return _build("recording", (4.9, 2.13, 1.51), np.random.default_rng(0))


def _build(name: str, size: tuple[float, float, float], rng: np.random.Generator) -> Vehicle:
    model = MODELS[name]
    length, width, height = size
    # CARLA's boxes leave up to a hand's breadth before and behind the body.
    body = width * rng.uniform(0.88, 0.97)
    parts = [_body(model, (length * rng.uniform(0.965, 1.0), body, height), rng)]
    parts += _wheels(length, body, height, rng)
    mirror_x = length * (rng.uniform(0.14, 0.19) if name not in ("van", "truck") else 0.3)
    mirror_z = height * (model.belt + rng.uniform(0.04, 0.1))
    for side in (-1.0, 1.0):
        reach = (width - body) / 2 + 0.08
        middle = (mirror_x, side * (width - reach) / 2, mirror_z)
        parts.append(boxes(middle, (0.1, reach, 0.15), 0.0))
    return Vehicle(name, size, join(parts))


def _body(model: Model, size: tuple[float, float, float], rng: np.random.Generator) -> Mesh:
    """The lofted body: an outline of ten points at each place of the top's profile."""
    length, width, height = size
    top = np.array(model.top)
    top[1:-1, 0] += rng.normal(0.0, 0.008, len(top) - 2)
    top[:, 0] = np.sort(np.clip(top[:, 0], -0.5, 0.5))
    top[:, 1] *= 1.0 + rng.normal(0.0, 0.025, len(top))
    top[:, 1] = np.minimum(top[:, 1], 1.0) / min(1.0, float(top[:, 1].max()))
    x, z = length * top[:, 0], height * top[:, 1]
    # Rounded corners seen from above.
    corner, power = rng.uniform(0.15, 0.42), rng.uniform(4.0, 7.0)
    half = width / 2 * (1.0 - corner * np.abs(2 * top[:, 0]) ** power)
    floor = model.floor + rng.uniform(-0.03, 0.05)
    # Nose and tail do not reach down to the under-body.
    low = floor + 0.3 * np.clip(np.abs(2 * top[:, 0]) - 0.85, 0.0, 1.0) * height
    belt = height * (model.belt + rng.uniform(-0.03, 0.03))
    shoulder = np.maximum(np.minimum(belt, z - 0.05), low + 0.05)
    roof = model.roof + rng.uniform(-0.06, 0.06)
    above = np.clip((z - belt) / (height - belt), 0.0, 1.0)
    edge = half * (0.9 + (roof - 0.9) * above)
    sill = low + 0.35 * (shoulder - low)
    bottom = half * 0.88
    crown = z - 0.03 * height * above - 0.015
    left = np.stack(
        [
            np.stack([x, bottom, low], axis=-1),
            np.stack([x, half, sill], axis=-1),
            np.stack([x, half * 0.97, shoulder], axis=-1),
            np.stack([x, edge, crown], axis=-1),
            np.stack([x, edge * 0.55, z], axis=-1),
        ],
        axis=1,
    )
    right = left[:, ::-1] * np.array([1.0, -1.0, 1.0])
    sections: Floats = np.concatenate([left, right], axis=1)
    return loft(sections)


def _wheels(length: float, body: float, height: float, rng: np.random.Generator) -> list[Mesh]:
    radius = min(0.5, height * rng.uniform(0.2, 0.235))
    base, broad, outer = rng.uniform(0.27, 0.31), 0.22, body / 2 - 0.02
    return [
        cylinder((place, side * outer, radius), (0.0, -side * broad, 0.0), radius, radius)
        for place in (-base * length, base * length)
        for side in (-1.0, 1.0)
    ]
