"""What robots saw: raw scans never cross the network, so a recorder opens the swarm's own world."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from deploy.spec import SwarmSpec
from options.recordings import format as layout
from options.recordings import shapes
from options.recordings.outlet import Outlet
from options.recordings.ranges import for_view, put_rays, put_scan
from swarm.errors import RecordingError
from swarm.messages import Detections
from worlds.base import Rayed, Scan, World
from worlds.registry import open_world


class Scans:
    """Writes a swarm's scans, poses and ground truth, frame by frame."""

    def __init__(
        self,
        spec: SwarmSpec,
        points: layout.Points,
        rate_hz: float | None,
        truth: bool = True,
        *,
        whole: bool = False,
    ) -> None:
        """Opens the world. Raises RecordingError for a rate that is not above 0, and WorldError
        when the world cannot be opened."""
        self.world: World = open_world(
            spec.world,
            data=Path(spec.data) if spec.data else None,
            robots=spec.room(),
            seed=spec.seed,
            rings=spec.rings,
            scenario=spec.scenario,
            cache=Path(spec.cache) if spec.cache else None,
        )
        if rate_hz is not None and not rate_hz > 0:
            raise RecordingError(f"rate {rate_hz} cannot be used; it must be frames a second > 0")
        self._truth = truth
        self._rays = self.world.rays() if isinstance(self.world, Rayed) and not whole else None
        self._rays_told = False
        self.robots = tuple(robot for robot in spec.robots if robot in self.world.robots)
        """Those of the swarm that the world has."""
        self._all = points == "all"
        self.stride = max(1, round(self.world.rate_hz / (rate_hz or self.world.rate_hz)))
        """Of the swarm's frames, those that it divides are written."""

    def wants(self, frame: int) -> bool:
        """Whether a frame of the swarm is written."""
        return frame % self.stride == 0

    def write(self, fused: Detections, outlet: Outlet) -> None:
        """Writes one frame. Raises WorldError when a scan cannot be had."""
        number, time_ns = fused.frame % self.world.frame_count, fused.capture_ns
        asked = {*fused.participants, *fused.missing}
        chosen = [robot for robot in self.robots if self._all or robot in asked]
        scans = {robot: self.world.scan(robot, number) for robot in chosen}
        poses = {
            robot: scans[robot].pose if robot in scans else self.world.pose(robot, number)
            for robot in self.robots
        }
        outlet.put(layout.TRANSFORMS, shapes.transforms(poses, time_ns), time_ns)
        for robot, scan in scans.items():
            self._write_scan(robot, scan, time_ns, outlet)
        if self._truth:
            self._write_truth(fused.frame, number, time_ns, outlet)
        # Last: where it is, all of the frame is.
        outlet.put_json(
            layout.FRAME,
            layout.Frame(
                frame=fused.frame,
                capture_ns=time_ns,
                robots={
                    robot: layout.RobotInFrame(
                        pose=pose.as_tuple(),
                        velocity=scans[robot].velocity if robot in scans else (0.0, 0.0, 0.0),
                        points=len(scans[robot].points) if robot in scans else None,
                    )
                    for robot, pose in poses.items()
                },
            ),
            time_ns,
        )

    def _write_scan(self, robot: str, scan: Scan, time_ns: int, outlet: Outlet) -> None:
        """As ranges where these give back each point, with some points for viewers; else whole."""
        points = scan.points
        if self._rays is not None and (ranges := put_scan(points, self._rays)) is not None:
            if not self._rays_told:
                outlet.put_json(layout.RAYS, put_rays(self._rays), time_ns)
                self._rays_told = True
            outlet.put_json(layout.ranges_topic(robot), ranges, time_ns)
            points = for_view(points)
        outlet.put(layout.points_topic(robot), shapes.cloud(robot, points, time_ns), time_ns)

    def _write_truth(self, frame: int, number: int, time_ns: int, outlet: Outlet) -> None:
        truth = self.world.ground_truth(number)
        if not len(truth.boxes):
            return
        found = truth.boxes
        boxes = tuple(
            layout.TrueBox(
                center=_three(center),
                size=_three(size),
                heading=heading,
                label=label,
                id=identity,
                visible_points=visible,
            )
            for center, size, heading, label, identity, visible in zip(
                found.centers.tolist(),
                found.sizes.tolist(),
                found.headings.tolist(),
                found.labels,
                truth.ids,
                truth.visible_points.tolist(),
                strict=True,
            )
        )
        outlet.put_json(layout.TRUTH, layout.Truth(frame=frame, boxes=boxes), time_ns)
        drawn = shapes.boxes(boxes, time_ns, shapes.TRUE_COLOR, 0.15)
        outlet.put(layout.TRUTH_BOXES, drawn, time_ns)


def _three(values: Iterable[float]) -> layout.Vector3:
    x, y, z = values
    return (x, y, z)
