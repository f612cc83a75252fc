"""A simulated factory floor: ray-cast LiDAR scans of shelving, machines, forklifts and workers."""

from worlds.factory.world import FactoryWorld

__all__ = ["FactoryWorld"]
