"""Reading, describing and coding scans."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from coadapt.api.cloud import Cloud, PoseLike, ScanLike, as_cloud
from perception.types import Boxes, Scene
from worlds.base import World


def scan(source: ScanLike, pose: PoseLike | None = None) -> Cloud:
    """A scan from wherever it is.

    `source` is a file (.pcd, .bin as KITTI has it, .ply, .npy), an array or list (N, 3) or (N, 4),
    or a world's scan: metres, in the sensor's frame (x forward, y left, z up). `pose` says where
    the sensor is in the world: a `Pose`, (x, y, z, roll, pitch, yaw), or the (4, 4) matrix
    world_from_sensor; a scan needs it to be fused with others.

    >>> import coadapt
    >>> coadapt.scan([[1, 2, 3], [4, 5, 6]], pose=(10, 0, 1.2, 0, 0, 0))
    Cloud(2 points up to 8.8 m away, at (10.00, 0.00, 1.20) m, yaw 0.00 rad)

    Raises WorldError for a file, and ScanError for an array or pose that cannot be used.
    """
    return as_cloud(source, pose)


def world(source: str | Path, **options: Any) -> World:
    """A world: robots with scans and poses, frame by frame.

    `source` is the name of one (factory, road; with the options of `worlds.registry.open_world`,
    as `robots=3, seed=7`), or the path of recorded data: a recording of a swarm (.mcap), a folder
    of robots' bags or folders of scans, or a directory in OPV2V's layout.

    >>> import coadapt
    >>> floor = coadapt.world("factory", robots=3, rings=16)
    >>> floor.robots
    ('R1', 'R2', 'R3')
    >>> coadapt.scan(floor.scan("R1", 0)).points.dtype
    dtype('float32')

    Raises WorldError for a name that is not known, and data or options that cannot be used.
    """
    from coadapt.recorded import names_data, open_recorded
    from worlds.registry import open_world

    if names_data(str(source)):
        data = open_recorded(Path(source))
        data.tell_notes()
        return data.world
    return open_world(str(source), **options)


def describe(scan: ScanLike, method: str = "fast", own_body_m: float | None = None) -> Scene:
    """The objects in a scan, in its sensor's frame: centroid, distance, size, points, density.

    Methods are `fast` (a grid) and `reference` (the published RANSAC and DBSCAN); objects nearer
    than `own_body_m` are taken for the robot's own body (default 2.1 m; 0 keeps them).

    >>> import coadapt
    >>> scene = coadapt.describe(coadapt.world("factory", robots=2, rings=16).scan("R1", 0))
    >>> nearest = min(scene.objects, key=lambda one: one.distance)
    >>> 2.1 < nearest.distance < 10.0
    True

    Raises ScanError for points that cannot be used, PerceptionError for an unknown method.
    """
    from perception.scene import OWN_BODY_M
    from perception.scene import describe as describe_points

    reach = OWN_BODY_M if own_body_m is None else own_body_m
    return describe_points(as_cloud(scan).points, method, reach)


def encode(what: ScanLike | Boxes, max_error_m: float = 0.1) -> bytes:
    """Points or boxes as they go over the air.

    Of points no error is larger than `max_error_m` (0.001 to 1 m); boxes take 20 bytes each, and
    are within 2.5 mm.

    >>> import coadapt
    >>> cloud = coadapt.scan(coadapt.world("factory", robots=2, rings=16).scan("R1", 0))
    >>> cloud.points.nbytes // len(coadapt.encode(cloud)) > 50
    True

    Raises PerceptionError for points or boxes that cannot be coded.
    """
    if isinstance(what, Boxes):
        from perception.codec.boxes import encode_boxes

        return encode_boxes(what)
    from perception.codec.points import encode_points

    return encode_points(as_cloud(what).points, max_error_m)


def decode(payload: bytes) -> Cloud | Boxes:
    """Reverses `encode`: points, in another order, or boxes.

    >>> import coadapt
    >>> coadapt.decode(coadapt.encode([[1, 2, 3], [4, 5, 6]], max_error_m=0.01))
    Cloud(2 points up to 8.8 m away, no pose)

    Raises PayloadError for bytes that are damaged or something else.
    """
    from perception.codec.boxes import KIND_BOXES, decode_boxes
    from perception.codec.envelope import unseal
    from perception.codec.points import decode_points

    if unseal(payload)[0] == KIND_BOXES:
        return decode_boxes(payload)
    return Cloud(decode_points(payload))
