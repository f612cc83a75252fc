"""A simulated town: ray-cast LiDAR scans of streets as OPV2V's recording cars see CARLA's."""

from worlds.road.world import RoadWorld

__all__ = ["RoadWorld"]
