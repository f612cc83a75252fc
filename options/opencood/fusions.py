"""OpenCOOD models behind the interface of perception/fusion/base.py.

Their boxes keep the model's own scores: nobody has calibrated them.
"""

from __future__ import annotations

import numpy as np

from options.opencood.model import OpenCoodModel, Scan
from options.opencood.payload import decode_map, encode_map
from perception.codec.boxes import decode_boxes, encode_boxes
from perception.codec.points import MAX_RANGE_M, decode_points, encode_points
from perception.fusion.base import Contribution, EncodeOptions, FrameRequest, Fusion, Gathering
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError, PerceptionError
from swarm.geometry import Matrix, Points, Pose, invert, pose_of

MAX_BOXES = 200
MAX_POINTS = 300_000
"""Of one payload: what one scan can hold, so that none holds up the frame of everybody."""


def opencood_fusion(model: OpenCoodModel) -> Fusion:
    """The fusion that the model was trained for."""
    kinds = {"early": OpenCoodEarly, "late": OpenCoodLate, "intermediate": OpenCoodIntermediate}
    return kinds[model.config.fusion](model)


class _OpenCood(Fusion):
    scored_as = ""


class OpenCoodEarly(_OpenCood):
    """`point_pillar` on the merged cloud of all vehicles."""

    name = "early"

    def __init__(self, model: OpenCoodModel) -> None:
        """Raises PerceptionError when the model fuses feature maps."""
        self._model = _of_kind(model, "point_pillar")

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The scan within the asked error. Its ground stays: the network was trained with it."""
        cloud = clean_points(points)
        cloud = cloud[(np.abs(cloud) <= MAX_RANGE_M).all(axis=1)]
        return encode_points(cloud, options.max_error_m)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts the merged cloud with the own scan."""
        return _Clouds(self._model, own, world_from_own)


class _Clouds(Gathering):
    def __init__(self, model: OpenCoodModel, own: Points, world_from_own: Matrix) -> None:
        self._model = model
        self._world_from_own = world_from_own
        self._scans: list[Scan] = [(clean_points(own), None)]

    def add(self, contribution: Contribution) -> None:
        points = decode_points(contribution.payload, MAX_POINTS)
        own_from_sensor = invert(self._world_from_own) @ contribution.world_from_sensor
        self._scans.append((points, own_from_sensor))

    def finish(self) -> Boxes:
        return self._model.detect(self._scans).transformed(self._world_from_own)


class OpenCoodLate(_OpenCood):
    """`point_pillar` on each vehicle; the ego keeps the best of boxes that overlap."""

    name = "late"

    def __init__(self, model: OpenCoodModel) -> None:
        """Raises PerceptionError when the model fuses feature maps."""
        self._model = _of_kind(model, "point_pillar")

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The boxes detected in the scan, best first, in the sensor's frame."""
        boxes = self._model.detect([(points, None)])
        return encode_boxes(boxes.take(np.arange(min(len(boxes), MAX_BOXES))))

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the boxes of the own scan."""
        return _Boxes(self._model, own, world_from_own)


class _Boxes(Gathering):
    def __init__(self, model: OpenCoodModel, own: Points, world_from_own: Matrix) -> None:
        self._model = model
        self._world_from_own = world_from_own
        self._parts = [model.detect([(own, None)])]

    def add(self, contribution: Contribution) -> None:
        boxes = decode_boxes(contribution.payload)
        if len(boxes) > MAX_BOXES:
            raise PayloadError(f"{len(boxes)} boxes in one scan; allowed: {MAX_BOXES}")
        own_from_sensor = invert(self._world_from_own) @ contribution.world_from_sensor
        self._parts.append(boxes.transformed(own_from_sensor))

    def finish(self) -> Boxes:
        return self._model.best(Boxes.concatenate(self._parts)).transformed(self._world_from_own)


class OpenCoodIntermediate(_OpenCood):
    """`point_pillar_intermediate`: maps made in the ego's frame, fused by attention (AttFuse)."""

    name = "intermediate"

    def __init__(self, model: OpenCoodModel, number_bytes: int = 2) -> None:
        """`number_bytes` of the map on the wire: 2 or 4. Raises PerceptionError for a model that
        fuses no feature maps."""
        self._model = _of_kind(model, "point_pillar_intermediate")
        self._number_bytes = number_bytes

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """A scan, float32 (N, 3) in the sensor's frame, as a map in the frame that the options ask
        for; in the sensor's own where none is asked for."""
        own = options.pose or Pose(0.0, 0.0, 0.0)
        world_from_ego = (options.reference or own).matrix()
        feature_map = self._model.encode(points, invert(world_from_ego) @ own.matrix())
        return encode_map(feature_map, self._model.version, world_from_ego, self._number_bytes)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts with the map of the own scan."""
        return _Maps(self._model, own, world_from_own)


class _Maps(Gathering):
    def __init__(self, model: OpenCoodModel, own: Points, world_from_own: Matrix) -> None:
        self._model = model
        self._world_from_own = world_from_own
        self._maps = [model.encode(own)]

    def ask(self) -> FrameRequest:
        return FrameRequest(reference=pose_of(self._world_from_own))

    def add(self, contribution: Contribution) -> None:
        model = self._model
        shape = model.map_shape()
        feature_map = decode_map(contribution.payload, model.version, shape, self._world_from_own)
        self._maps.append(feature_map)

    def finish(self) -> Boxes:
        return self._model.fuse(self._maps).transformed(self._world_from_own)


def _of_kind(model: OpenCoodModel, core_method: str) -> OpenCoodModel:
    if model.config.core_method != core_method:
        raise PerceptionError(
            f"the OpenCOOD model is a {model.config.core_method}; allowed here: {core_method}"
        )
    return model
