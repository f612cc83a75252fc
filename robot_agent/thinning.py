"""How often one robot speaks, and how much it says, within what egos let its messages take.

The newest goes first: a message that is not due is never made, so that nothing old waits anywhere.
Beacons come before scenes, as where a robot is ages faster than what it sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np

from swarm.arrays import pack, unpack_finite
from swarm.messages import Beacon, SceneDescription, encode

WIRE_BYTES = 120
"""Of a message's key, Zenoh's, TCP's, IP's and Ethernet's headers."""
BEACON_SHARE = 0.7
"""Of the budget; scenes have the rest."""
SIZES_PERIOD_S = 2.0
"""Sizes that stay about the same, and the body, are told this often."""
ALIKE = 0.1
"""Sizes that differ by less than this share are about the same."""
MARK_PERIOD_S = 1.0
"""The robot's world and version are told this often, so that who has just come hears of them."""
RARELY = 5
"""Where beacons are few, only one in so many tells these again: the next one comes the sooner."""
MAX_SCENE_GAP_S = 3.0
"""Egos forget a scene after 5 s; rather a small one in time than a large one too late."""
MIN_SECTORS = 24
"""Sectors of 15 degrees still show where a robot's view is blocked."""
_POINTS = 7


@dataclass(slots=True)
class Thinner:
    """Decides for one robot; each method belongs to one thread."""

    _beacon_due: float = 0.0
    _beacon_gap_s: float = 0.0
    """From the last beacon until the next one is due."""
    _scene_due: float = 0.0
    _sizes: dict[str, int] = field(default_factory=dict)
    """Told last, and when."""
    _sizes_at: float = float("-inf")
    _marked_at: float = float("-inf")

    def beacon_is_due(self, now: float) -> bool:
        """Whether a beacon may be sent at `now`, seconds on a steady clock."""
        return now >= self._beacon_due

    def scene_is_due(self, now: float) -> bool:
        """Whether a scene may be sent."""
        return now >= self._scene_due

    def beacon(self, beacon: Beacon, budget_bps: int | None, now: float) -> Beacon:
        """The beacon to send now; without a budget it tells all but its world, which never
        changes."""
        if now - self._marked_at < self._period_s(MARK_PERIOD_S):
            beacon = msgspec.structs.replace(beacon, world="", software="")
        else:
            self._marked_at = now
        if budget_bps is None:
            self._beacon_due = self._beacon_gap_s = 0.0
            return beacon
        told_s = now - self._sizes_at
        if _alike(beacon.sizes, self._sizes) and told_s < self._period_s(SIZES_PERIOD_S):
            beacon = msgspec.structs.replace(beacon, sizes={}, body=None)
        else:
            self._sizes, self._sizes_at = beacon.sizes, now
        bits = 8.0 * (len(encode(beacon)) + WIRE_BYTES)
        self._beacon_gap_s = bits / (BEACON_SHARE * budget_bps)
        self._beacon_due = now + self._beacon_gap_s
        return beacon

    def _period_s(self, at_least_s: float) -> float:
        return max(at_least_s, RARELY * self._beacon_gap_s)

    def scene(
        self, scene: SceneDescription, budget_bps: int | None, now: float
    ) -> SceneDescription:
        """The scene to send now: of one that is too large the objects with the most points."""
        if budget_bps is None:
            self._scene_due = 0.0
            return scene
        share_bps = (1.0 - BEACON_SHARE) * budget_bps
        scene = _fitted(scene, int(share_bps * MAX_SCENE_GAP_S / 8.0) - WIRE_BYTES)
        self._scene_due = now + min(
            MAX_SCENE_GAP_S, 8.0 * (len(encode(scene)) + WIRE_BYTES) / share_bps
        )
        return scene


def _alike(one: Mapping[str, int], other: Mapping[str, int]) -> bool:
    return one.keys() == other.keys() and all(
        abs(size - other[name]) <= ALIKE * other[name] for name, size in one.items()
    )


def _fitted(scene: SceneDescription, allowed_bytes: int) -> SceneDescription:
    """The scene in about as many bytes, or the smallest one there is."""
    objects = unpack_finite(scene.objects, "objects", 9)
    visible = unpack_finite(scene.visible_m, "visible_m", 1)
    too_many = len(encode(scene)) - allowed_bytes
    if too_many <= 0:
        return scene
    if len(visible) > MIN_SECTORS and len(visible) % MIN_SECTORS == 0:
        # What is hidden in a part of a sector is not seen in the whole.
        coarse = visible.reshape(MIN_SECTORS, -1).min(axis=1, keepdims=True)
        too_many -= visible.nbytes - coarse.nbytes
        visible = coarse
    kept = max(0, len(objects) - max(0, -(-too_many // (objects.itemsize * objects.shape[1]))))
    best = np.sort(np.argsort(-objects[:, _POINTS], kind="stable")[:kept])
    return msgspec.structs.replace(scene, objects=pack(objects[best]), visible_m=pack(visible))
