"""`reference`: the method of the CoAdapt paper, as its published code sets it.

RANSAC plane removal, then DBSCAN, both from Open3D, on all points. Parameters:
github.com/houssamhh/CoAdapt, lidar_processing/interpret_pointcloud.py.
"""

from __future__ import annotations

import numpy as np

from perception.scene.segmentation import Segmentation
from swarm.geometry import Points

PLANE_DISTANCE_M = 0.2
PLANE_POINTS = 3
PLANE_ITERATIONS = 200
NEIGHBOUR_DISTANCE_M = 0.5
MIN_NEIGHBOURS = 10
SEED = 0
"""Open3D's generator is shared by the process; seeded before each scan, results repeat."""


def segment(points: Points) -> Segmentation:
    """Ground and objects of finite points, float32 (N, 3), sensor frame, metres."""
    if not len(points):
        return Segmentation.empty()
    import open3d as o3d  # takes a second: only for those who ask for this method

    ground = np.zeros(len(points), dtype=np.bool_)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    if len(points) >= PLANE_POINTS:
        o3d.utility.random.seed(SEED)
        _, inliers = cloud.segment_plane(PLANE_DISTANCE_M, PLANE_POINTS, PLANE_ITERATIONS)
        ground[inliers] = True
        cloud = cloud.select_by_index(inliers, invert=True)
    labels = np.asarray(cloud.cluster_dbscan(NEIGHBOUR_DISTANCE_M, MIN_NEIGHBOURS), dtype=np.int32)
    clustered = labels >= 0
    members = np.flatnonzero(~ground)[clustered]
    return Segmentation(points, ground, members, labels[clustered], int(labels.max(initial=-1)) + 1)
