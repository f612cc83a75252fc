"""The ROS 2 message types that fused objects leave in: their fields, and the hashes of these.

A hash is that of REP-2011 (https://ros.org/reps/rep-2011.html) over the fields of a type and of all
types in it; constants and comments do not count.
"""

from __future__ import annotations

DETECTIONS = "vision_msgs/msg/Detection3DArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
GRID = "nav_msgs/msg/OccupancyGrid"

HASHES = {
    DETECTIONS: "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    MARKERS: "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    GRID: "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
}
NO_HASH = "TypeHashNotSupported"
"""What ROS 2 Humble, which has no hashes, writes in their place."""

_RULE = "=" * 80
_FIELDS = {
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec, uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "std_msgs/ColorRGBA": "float32 r, float32 g, float32 b, float32 a",
    "geometry_msgs/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose, float64[36] covariance",
    "sensor_msgs/CompressedImage": "std_msgs/Header header, string format, uint8[] data",
    "vision_msgs/ObjectHypothesis": "string class_id, float64 score",
    "vision_msgs/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis, "
    "geometry_msgs/PoseWithCovariance pose",
    "vision_msgs/BoundingBox3D": "geometry_msgs/Pose center, geometry_msgs/Vector3 size",
    "vision_msgs/Detection3D": "std_msgs/Header header, "
    "vision_msgs/ObjectHypothesisWithPose[] results, vision_msgs/BoundingBox3D bbox, string id",
    "vision_msgs/Detection3DArray": "std_msgs/Header header, vision_msgs/Detection3D[] detections",
    "visualization_msgs/UVCoordinate": "float32 u, float32 v",
    "visualization_msgs/MeshFile": "string filename, uint8[] data",
    "visualization_msgs/Marker": "std_msgs/Header header, string ns, int32 id, int32 type, "
    "int32 action, geometry_msgs/Pose pose, geometry_msgs/Vector3 scale, std_msgs/ColorRGBA color, "
    "builtin_interfaces/Duration lifetime, bool frame_locked, geometry_msgs/Point[] points, "
    "std_msgs/ColorRGBA[] colors, string texture_resource, sensor_msgs/CompressedImage texture, "
    "visualization_msgs/UVCoordinate[] uv_coordinates, string text, string mesh_resource, "
    "visualization_msgs/MeshFile mesh_file, bool mesh_use_embedded_materials",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time, float32 resolution, "
    "uint32 width, uint32 height, geometry_msgs/Pose origin",
    "nav_msgs/OccupancyGrid": "std_msgs/Header header, nav_msgs/MapMetaData info, int8[] data",
}
"""Of each type; visualization_msgs as since Humble, vision_msgs as since its version 4."""


def definition(kind: str) -> str:
    """A type's fields and those of all types in it, as MCAP's schema encoding `ros2msg` has them.

    kind: as ROS users write it, `nav_msgs/msg/OccupancyGrid`. Raises KeyError for another type than
    those that leave.
    """
    names = [kind.replace("/msg/", "/")]
    for name in names:
        parts = (field.split(" ")[0].partition("[")[0] for field in _FIELDS[name].split(", "))
        names += dict.fromkeys(part for part in parts if part in _FIELDS and part not in names)
    texts = [_FIELDS[name].replace(", ", "\n") + "\n" for name in names]
    others = zip(names[1:], texts[1:], strict=True)
    return texts[0] + "".join(f"{_RULE}\nMSG: {name}\n{text}" for name, text in others)
