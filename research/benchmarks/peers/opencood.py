"""OpenCOOD's PointPillar, early and intermediate fusion, from a checkout that the reader fetches.

Its own data set class, pre-processing, network and post-processing run, frame by frame as its
inference script does, on clouds that are in memory already. Switched off is what only training and
evaluation need: labels, ground truth, pictures. Anchors, which it makes anew for each frame, are
made once. Weights are random, with statistics of a real frame, and the last layer's bias is such
that CANDIDATES anchors of that frame pass the score threshold, about as many as of a trained
network: how long anything takes depends on the weights through nothing else.

Ours, on the same frames: encoding at the sender, decoding, pose correction, detection, in turn on
the same threads.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import os
import sys
import time
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from options.opencood.clouds import ATTENUATION_PER_M
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.detectors import detector_backend
from perception.fusion.registry import make_fusion
from research.benchmarks.intervals import ratio_of_medians
from research.benchmarks.peers.frames import Shared, shared_frames
from swarm.geometry import Points, Pose
from worlds.base import Scan

VARIABLE = "OPENCOOD"
"""Names the checkout, here as in the tests."""
PAIRS = {"early": "early", "intermediate": "intermediate-codebook"}
"""Their fusion, and ours beside it."""
PARTS = ("preprocess", "network", "postprocess")
ROUNDS = 2
CANDIDATES = 100


def why_not() -> str | None:
    """Why OpenCOOD cannot be measured here, or None."""
    checkout = os.environ.get(VARIABLE)
    if not checkout:
        return f"set {VARIABLE} to a checkout of github.com/DerrickXuNu/OpenCOOD"
    if not (Path(checkout) / "opencood" / "models").is_dir():
        return f"{VARIABLE}={checkout} is no checkout of OpenCOOD"
    return None


def ratios() -> tuple[dict[str, Any], dict[str, Any]]:
    """`ratio_opencood_*` (our time over theirs) and what they are made of; samples. Where OpenCOOD
    is not at hand the ratios are None, and `opencood_missing` says why."""
    nothing = dict.fromkeys(f"ratio_opencood_{fusion}" for fusion in PAIRS)
    if (missing := why_not()) is not None:
        return nothing | {"opencood_missing": missing}, {}
    shared = shared_frames()
    try:
        with importable(Path(os.environ[VARIABLE])):
            timed = {fusion: _in_turn(fusion, ours, shared) for fusion, ours in PAIRS.items()}
    except ImportError as error:
        return nothing | {"opencood_missing": f"it needs what is not installed: {error}"}, {}
    figures: dict[str, Any] = {}
    rows = []
    for fusion, times in timed.items():
        theirs = [sum(parts) for parts in times.theirs_ms]
        ratio, interval = ratio_of_medians(times.ours_ms, theirs)
        figures[f"ratio_opencood_{fusion}"] = ratio
        parts_ms = np.median(times.theirs_ms, axis=0)
        rows.append(
            {
                "fusion": fusion,
                "ours": PAIRS[fusion],
                "ratio": ratio,
                "ratio_interval": interval,
                "ours_ms_p50": round(float(np.median(times.ours_ms)), 2),
                "opencood_ms_p50": round(float(np.median(theirs)), 2),
                **{
                    f"opencood_{part}_ms_p50": round(float(ms), 2)
                    for part, ms in zip(PARTS, parts_ms, strict=True)
                },
                "n": len(theirs),
            }
        )
    figures["opencood_missing"] = None
    figures["opencood"] = {
        "rows": rows,
        "frames": shared.name,
        "vehicles": len(shared.scans[0]),
        "voxels": "spconv" if has_spconv() else "NumPy, as spconv is not installed",
        "weights": "random",
        "our_backend": detector_backend(shared.detector),
        "threads": torch.get_num_threads(),
    }
    samples = {
        fusion: {"ours_ms": times.ours_ms, "opencood_parts_ms": times.theirs_ms}
        for fusion, times in timed.items()
    }
    return figures, samples


@dataclass(frozen=True, slots=True)
class Times:
    """Milliseconds, frame by frame and round by round."""

    ours_ms: list[float]
    theirs_ms: list[tuple[float, ...]]
    """Of PARTS."""


def _in_turn(fusion: str, ours: str, shared: Shared) -> Times:
    theirs = OpenCood(fusion, vehicles(shared.scans[0]))
    detector = make_fusion(ours, shared.detector)
    times = Times([], [])
    for number in range(ROUNDS + 1):
        for scans in shared.scans[: None if number else 1]:
            mine = _ours_ms(detector, scans)
            parts = theirs.detect(vehicles(scans))
            if number:  # The first round is for imports and first allocations.
                times.ours_ms.append(round(mine, 3))
                times.theirs_ms.append(tuple(round(ms, 3) for ms in parts))
    return times


def _ours_ms(fusion: Fusion, scans: Sequence[Scan]) -> float:
    ego, *others = scans
    begun = time.perf_counter()
    gathering = fusion.begin(ego.points, ego.pose.matrix())
    ask = gathering.ask()
    gathering.prepare()
    for other in others:
        options = EncodeOptions(pose=other.pose, reference=ask.reference, demand=ask.demand)
        payload = fusion.encode(other.points, options)
        gathering.add(Contribution(other.robot, payload, other.pose.matrix()))
    gathering.finish()
    return (time.perf_counter() - begun) * 1e3


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What OpenCOOD reads of one vehicle: float32 (N, 4) and x, y, z, roll, yaw, pitch in metres
    and degrees, in CARLA's left-handed frames."""

    cloud: NDArray[np.float32]
    lidar_pose: list[float]


def vehicles(scans: Sequence[Scan]) -> list[Vehicle]:
    """Of a frame's scans, in their order: the ego first."""
    return [Vehicle(left_handed(scan.points), lidar_pose(scan.pose)) for scan in scans]


def left_handed(points: Points) -> NDArray[np.float32]:
    """x, y, z and CARLA's intensity, float32 (N, 4), of points (N, 3) in the sensor's frame."""
    distance = np.linalg.norm(points, axis=1)
    intensity = np.exp(-ATTENUATION_PER_M * distance)
    return np.column_stack([points * [1.0, -1.0, 1.0], intensity]).astype(np.float32)


def lidar_pose(pose: Pose) -> list[float]:
    """A sensor's pose in the world, as OPV2V's files have it (`worlds.opv2v.carla.pose`)."""
    angles = (pose.roll, -pose.yaw, -pose.pitch)
    return [pose.x, -pose.y, pose.z, *map(math.degrees, angles)]


class OpenCood:
    """One of its fusions with random weights; needs `importable`."""

    def __init__(self, fusion: str, frame: Sequence[Vehicle]) -> None:
        """`frame` gives the network's statistics and the bias of its scores."""
        settings = importlib.import_module("opencood.hypes_yaml.yaml_utils")
        folder = Path(str(settings.__file__)).parent
        hypes = settings.load_yaml(str(folder / f"point_pillar_{fusion}_fusion.yaml"))
        if fusion == "early":
            # The published file says so of intermediate fusion only; it is the default.
            hypes["postprocess"]["anchor_args"].setdefault("feature_stride", 2)
        self._data = _without_files(fusion, hypes)
        name = hypes["model"]["core_method"]
        module = importlib.import_module(f"opencood.models.{name}")
        network = getattr(module, name.title().replace("_", ""))
        torch.manual_seed(0)
        self._network = network(hypes["model"]["args"])
        self._calibrate(frame, hypes["postprocess"]["target_args"]["score_threshold"])

    def detect(self, frame: Sequence[Vehicle]) -> tuple[float, float, float]:
        """Milliseconds of pre-processing, network and post-processing."""
        with torch.no_grad():
            begun = time.perf_counter()
            batch = self._read(frame)
            read = time.perf_counter()
            found = self._network(batch["ego"])
            computed = time.perf_counter()
            self._data.post_processor.post_process(batch, {"ego": found})
            ended = time.perf_counter()
        return (read - begun) * 1e3, (computed - read) * 1e3, (ended - computed) * 1e3

    def _read(self, frame: Sequence[Vehicle]) -> dict[str, Any]:
        self._data.frame = frame
        batch: dict[str, Any] = self._data.collate_batch_test([self._data[0]])
        return batch

    def _calibrate(self, frame: Sequence[Vehicle], threshold: float) -> None:
        layers = [m for m in self._network.modules() if hasattr(m, "running_mean")]
        for layer in layers:
            layer.momentum = None  # Plain means over what is seen from now on.
        with torch.no_grad():
            self._network.train()
            batch = self._read(frame)
            for _ in layers[:3]:
                self._network(batch["ego"])
            self._network.eval()
            self._network.reg_head.weight.mul_(0.1)
            scores = self._network(batch["ego"])["psm"].flatten()
            least = scores.topk(CANDIDATES).values[-1]
            self._network.cls_head.bias += math.log(threshold / (1.0 - threshold)) - least


def _without_files(fusion: str, hypes: dict[str, Any]) -> Any:
    """The data set of a fusion, which reads `frame` instead of files, and makes no labels."""
    module = importlib.import_module(f"opencood.data_utils.datasets.{fusion}_fusion_dataset")
    base = getattr(module, f"{fusion.title()}FusionDataset")
    turned = importlib.import_module("opencood.utils.transformation_utils").x1_to_x2

    class InMemory(base):  # type: ignore[misc,valid-type]
        frame: Sequence[Vehicle] = ()

        def retrieve_base_data(self, idx: int, **_: Any) -> OrderedDict[str, Any]:
            ego = self.frame[0].lidar_pose
            return OrderedDict(
                (str(number), _record(one, number == 0, turned(one.lidar_pose, ego)))
                for number, one in enumerate(self.frame)
            )

    # Its constructor lists a directory.
    data = InMemory.__new__(InMemory)
    data.params, data.visualize, data.train, data.max_cav = hypes, False, False, 5
    data.proj_first, data.cur_ego_pose_flag = True, True
    data.augment = lambda *parts: parts
    builders = importlib.import_module(f"{base.__module__}")
    data.pre_processor = builders.build_preprocessor(hypes["preprocess"], False)
    post = importlib.import_module("opencood.data_utils.post_processor")
    data.post_processor = post.build_postprocessor(hypes["postprocess"], False)
    anchors = data.post_processor.generate_anchor_box()
    data.post_processor.generate_anchor_box = lambda: anchors
    nothing = (np.zeros((1, 7)), np.ones(1), [0])
    data.post_processor.generate_object_center = lambda *_: nothing
    data.post_processor.generate_label = lambda **_: {}
    data.post_processor.collate_batch = lambda _: {}
    return data


def _record(one: Vehicle, is_ego: bool, to_ego: NDArray[np.float64]) -> dict[str, Any]:
    params = {
        "lidar_pose": one.lidar_pose,
        "transformation_matrix": to_ego,
        "spatial_correction_matrix": np.eye(4),
        "ego_speed": 0.0,
    }
    # It shuffles and moves points in place.
    cloud = one.cloud.copy()
    return {"ego": is_ego, "time_delay": 0, "params": params, "lidar_np": cloud}


def has_spconv() -> bool:
    """Whether its voxel generator is installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("spconv", "cumm"))


@contextmanager
def importable(checkout: Path) -> Iterator[None]:
    """OpenCOOD's modules can be imported meanwhile. What they import only for labels (compiled) and
    for pictures is empty, and so is the voxel generator where it is not installed."""
    before = set(sys.modules)
    with ExitStack() as stack:
        sys.path.insert(0, str(checkout))
        stack.callback(sys.path.remove, str(checkout))
        stack.callback(lambda: [sys.modules.pop(name, None) for name in set(sys.modules) - before])
        _stand_in("opencood.utils.box_overlaps", bbox_overlaps=None)
        _stand_in("opencood.visualization", __path__=[], vis_utils=None)
        _stand_in("opencood.visualization.vis_utils")
        if not has_spconv():
            _stand_in("cumm", tensorview=None)
            _stand_in("spconv", __path__=[])
            _stand_in("spconv.utils", VoxelGeneratorV2=Voxels)
        yield


def _stand_in(name: str, **attributes: Any) -> None:
    module = ModuleType(name)
    vars(module).update(attributes)
    sys.modules[name] = module


class Voxels:
    """What spconv's voxel generator does, with its parameters."""

    def __init__(
        self,
        voxel_size: list[float],
        point_cloud_range: list[float],
        max_num_points: int,
        max_voxels: int,
    ) -> None:
        self._low = np.array(point_cloud_range[:3], dtype=np.float32)
        self._size = np.array(voxel_size, dtype=np.float32)
        self._cells = np.round((np.array(point_cloud_range[3:]) - self._low) / self._size)
        self._points, self._voxels = max_num_points, max_voxels

    def generate(self, cloud: NDArray[np.float32]) -> tuple[NDArray[Any], ...]:
        """Voxels (V, P, 4), their z, y, x (V, 3), and how many points each holds (V,)."""
        cells = np.floor((cloud[:, :3] - self._low) / self._size).astype(np.int64)
        inside = ((cells >= 0) & (cells < self._cells)).all(axis=1)
        cloud, cells = cloud[inside], cells[inside].astype(np.int32)
        width, height, _ = self._cells.astype(np.int64)
        keys = (cells[:, 2].astype(np.int64) * height + cells[:, 1]) * width + cells[:, 0]
        order = np.argsort(keys, kind="stable")
        _, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
        place = np.arange(len(order)) - np.repeat(first, counts)
        voxel = np.repeat(np.arange(len(first)), counts)
        kept = (place < self._points) & (voxel < self._voxels)
        found = np.zeros((min(len(first), self._voxels), self._points, 4), dtype=np.float32)
        found[voxel[kept], place[kept]] = cloud[order[kept]]
        where = cells[order[first]][: len(found), ::-1]
        return found, where, np.minimum(counts, self._points)[: len(found)].astype(np.int32)
