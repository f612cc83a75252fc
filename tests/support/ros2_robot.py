"""A live robot for tests: publishes on a real router as rmw_zenoh does.

Keys, tokens and attachments are spelled here by themselves, from rmw_zenoh's docs/design.md; the
messages are the `rosbags` package's.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray
from zenoh import ext

from swarm.geometry import Pose
from tests.support.bag_files import CLOUD, ODOMETRY, STORE, TRANSFORMS, cloud, odometry, transforms

HASH = "RIHS01_" + "5a" * 32
GID = bytes(range(16))
NAMES = {
    CLOUD: "sensor_msgs::msg::dds_::PointCloud2_",
    ODOMETRY: "nav_msgs::msg::dds_::Odometry_",
    TRANSFORMS: "tf2_msgs::msg::dds_::TFMessage_",
    "std_msgs/msg/String": "std_msgs::msg::dds_::String_",
}
CORNER = np.array([[2.0, 0, 0.5], [2, 1, 0.5], [2, 2, 0.5], [1, 2, 0.5]], dtype=np.float32)


class Robot:
    """One rmw_zenoh session: a peer of the router, with time stamps on, as is its default."""

    def __init__(
        self, port: int, domain: int = 0, *, clock_s: float = 0.0, buffers: bool = False
    ) -> None:
        """`clock_s`: how far its clock is ahead. `buffers`: volatile messages come on a topic's
        key only while a token tells of a subscription, as of types that buffers can carry
        (ros2/rmw_zenoh#930)."""
        config = {
            "mode": "peer",
            "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
            "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
            "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
        }
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self.domain = domain
        self._ahead_ns = round(clock_s * 1e9)
        self.begun_ns = self.now_ns()
        self._counts: dict[str, int] = {}
        self._publishers: dict[str, Any] = {}
        self._tokens: list[Any] = []
        self._buffers = buffers
        self._listened: dict[str, str] = {}
        """The topic of each subscription's token."""
        self._listeners = self.session.liveliness().declare_subscriber(
            f"@ros2_lv/{domain}/*/*/*/MS/**", self._note_listener, history=True
        )
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.session.close()

    def now_ns(self) -> int:
        return time.time_ns() + self._ahead_ns

    def age_s(self, now_ns: int) -> float:
        """Since the robot began."""
        return (now_ns - self.begun_ns) / 1e9

    def nodes(self) -> list[str]:
        """As `ros2 node list`."""
        replies = self.session.liveliness().get(f"@ros2_lv/{self.domain}/*/0/0/NN/%/%/*", timeout=5)
        return sorted(str(one.ok.key_expr).rsplit("/", 1)[1] for one in replies if one.ok)

    def announce(self, topic: str, kind: str, *, kept: bool = False) -> None:
        """Declares a publisher and its token; `kept`: transient local, as tf_static is."""
        key = f"{self.domain}{topic}/{NAMES[kind]}/{HASH}"
        cache = ext.CacheConfig(1) if kept else None
        self._publishers[topic] = ext.declare_advanced_publisher(
            self.session, key, cache=cache, publisher_detection=kept
        )
        token = (
            f"@ros2_lv/{self.domain}/{self.session.zid()}/0/{len(self._tokens)}/MP/%/%/driver/"
            f"{topic.replace('/', '%')}/{NAMES[kind]}/{HASH}/::,7:,:,:,,"
        )
        self._tokens.append(self.session.liveliness().declare_token(token))

    def say(
        self,
        topic: str,
        kind: str,
        message: Any,
        *,
        attach: bool = True,
        skip: int = 0,
        took_s: float = 0.0,
    ) -> None:
        """Publishes a message, or bytes as they are.

        `skip`: numbers left out before it; `took_s`: as if it was published so long ago.
        """
        if topic not in self._publishers:
            self.announce(topic, kind, kept=topic.endswith("tf_static"))
        raw = message if isinstance(message, bytes) else bytes(STORE.serialize_cdr(message, kind))
        number = self._counts[topic] = self._counts.get(topic, 0) + 1 + skip
        published_ns = self.now_ns() - round(took_s * 1e9)
        told = number.to_bytes(8, "little") + published_ns.to_bytes(8, "little") + b"\x10" + GID
        if self._heard(topic):
            self._publishers[topic].put(raw, attachment=told if attach else None)

    def _heard(self, topic: str) -> bool:
        """Whether what is said on a topic goes to its key."""
        volatile = not topic.endswith("tf_static")
        return not (self._buffers and volatile) or topic in list(self._listened.values())

    def _note_listener(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._listened[token] = token.split("/")[9].replace("%", "/")
        else:
            self._listened.pop(token, None)

    def every(self, period_s: float, say: Callable[[int], None]) -> threading.Event:
        """Calls with the robot's time again and again; setting the event ends that."""
        stop = threading.Event()

        def loop() -> None:
            while not (stop.wait(period_s) or self._stop.is_set()):
                say(self.now_ns())

        self._threads.append(threading.Thread(target=loop, daemon=True))
        self._threads[-1].start()
        return stop

    def scan(self, points: NDArray[Any] = CORNER, topic: str = "/points", **how: Any) -> None:
        """Publishes one scan of now."""
        self.say(topic, CLOUD, cloud(self.now_ns(), points), **how)

    def scans(self, points: NDArray[Any] = CORNER, period_s: float = 0.05) -> threading.Event:
        """Scans of now, taken by `lidar`."""
        return self.every(period_s, lambda now: self.scan(points))

    def drive(self, pose: Pose, speed: float = 0.0, **names: Any) -> threading.Event:
        """Odometry, every 10 ms: at `pose` when the robot began, driving along x."""

        def say(now: int) -> None:
            at = Pose(pose.x + speed * self.age_s(now), pose.y, pose.z, yaw=pose.yaw)
            self.say("/odom", ODOMETRY, odometry(now, at, (speed, 0, 0), **names))

        return self.every(0.01, say)

    def mount(self, pose: Pose, base: str = "base_link") -> None:
        """Says once where the LiDAR is."""
        self.say("/tf_static", TRANSFORMS, transforms(self.now_ns(), {(base, "lidar"): pose}))
