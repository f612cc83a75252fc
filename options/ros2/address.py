"""`ros2://`: where a live robot is, which of its topics are read, and how."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl, urlsplit

import msgspec

from options.ros.track import MOST
from options.ros2 import FORM
from swarm.errors import SettingError
from swarm.geometry import Pose

PORT = 7447
"""Of rmw_zenoh's router."""
MAX_DOMAIN = 232
_DOMAIN = re.compile(r"[0-9]{1,3}")
TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_TOPICS = ("points", "odom", "tf", "tf_static")
_POSE = f"x,y,z or x,y,z,roll,pitch,yaw in metres and radians, each from -{MOST:.0f} to {MOST:.0f}"


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """Where ROS is: rmw_zenoh's router, and the domain."""

    host: str
    port: int = PORT
    domain: int

    @property
    def router(self) -> str:
        """The Zenoh router's locator."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"tcp/{host}:{self.port}"


class Address(Place, frozen=True, kw_only=True):
    """One live robot. Make it with `parse`, which checks every part."""

    points: str
    """Topic of its scans."""
    odom: str = ""
    """Topic that says where it is; empty where tf does."""
    tf: str = ""
    tf_static: str = ""
    """Topic of transforms that stay; by default beside `tf`."""
    sensor: Pose | None = None
    """The LiDAR on the robot's base, in place of what tf_static says."""
    origin: Pose = Pose(0.0, 0.0, 0.0)
    """Where the robot's fixed frame (its odometry's or tf's) lies in the world."""
    detector: Literal["factory", "road"] = "factory"
    rate: Annotated[float, msgspec.Meta(gt=0, le=100)] = 10.0
    """Frames a second of the swarm, Hz."""
    max_age: Annotated[float, msgspec.Meta(gt=0, le=60)] = 0.5
    """Seconds after which a scan or a pose says nothing about now."""
    stamps: Literal["header", "arrival"] = "header"
    """Whether a scan was taken when its header says, or when it arrives."""

    @property
    def max_age_ns(self) -> int:
        """`max_age` in nanoseconds."""
        return round(self.max_age * 1e9)


def split(text: str, form: str) -> tuple[Place, dict[str, str]]:
    """Where ROS is, and the options as they are written; `form` is what the URL must be.

    Raises SettingError that names the part, its value and what is allowed.
    """
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
        pairs = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError as error:
        raise SettingError(f"address {text!r} is not valid: {error}; it must be {form}") from error
    domain = parts.path.strip("/") or "0"
    if parts.scheme != "ros2" or not host or parts.username or parts.fragment:
        raise SettingError(f"address {text!r} is not valid; it must be {form}")
    if port == 0:
        raise wrong(text, "port", "0", "a TCP port from 1 to 65535")
    if not _DOMAIN.fullmatch(domain) or int(domain) > MAX_DOMAIN:
        raise wrong(text, "domain", domain, f"a ROS_DOMAIN_ID from 0 to {MAX_DOMAIN}")
    options: dict[str, str] = {}
    for name, value in pairs:
        if name in options:
            raise SettingError(f"address {text!r} gives {name!r} twice")
        options[name] = value
    return Place(host=host, port=port or PORT, domain=int(domain)), options


def parse(text: str) -> Address:
    """The address in a `ros2://` URL.

    Raises SettingError that names the part, its value and what is allowed.
    """
    place, options = split(text, FORM)
    values: dict[str, Any] = {"host": place.host, "port": place.port, "domain": place.domain}
    values |= {name: _value(text, name, value) for name, value in options.items()}
    if "points" not in values:
        raise SettingError(f"address {text!r} lacks points=/TOPIC, the topic of its scans")
    if ("odom" in values) == ("tf" in values):
        raise SettingError(
            f"address {text!r} must name one topic that says where the robot is: "
            "odom=/TOPIC (nav_msgs/msg/Odometry) or tf=/TOPIC (tf2_msgs/msg/TFMessage)"
        )
    values.setdefault("tf_static", values.get("tf", "/tf") + "_static")
    _check_topics_differ(text, values)
    return Address(**values)


_OPTIONS = [
    field
    for field in msgspec.structs.fields(Address)
    if field.name not in ("host", "port", "domain")
]


def _value(text: str, name: str, value: str) -> Any:
    field = next((field for field in _OPTIONS if field.name == name), None)
    if field is None:
        allowed = ", ".join(field.name for field in _OPTIONS)
        raise SettingError(f"address {text!r} has the option {name!r}; allowed: {allowed}")
    if name in _TOPICS:
        if not TOPIC.fullmatch(value):
            raise wrong(text, name, value, "a topic's full name, like /lidar/points")
        return value
    if name in ("sensor", "origin"):
        return _pose(text, name, value)
    try:
        number = msgspec.convert(value, field.type, strict=False)
    except msgspec.ValidationError as error:
        raise wrong(text, name, value, _ALLOWED[name]) from error
    if isinstance(number, float) and not math.isfinite(number):
        raise wrong(text, name, value, _ALLOWED[name])
    return number


_ALLOWED = {
    "detector": "factory or road",
    "rate": "frames a second > 0 and <= 100",
    "max_age": "seconds > 0 and <= 60",
    "stamps": "header or arrival",
}


def _pose(text: str, name: str, value: str) -> Pose:
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError as error:
        raise wrong(text, name, value, _POSE) from error
    if len(numbers) not in (3, 6) or not all(abs(one) <= MOST for one in numbers):
        raise wrong(text, name, value, _POSE)
    return Pose(*numbers)


def _check_topics_differ(text: str, values: dict[str, Any]) -> None:
    """Raises SettingError for two options with one topic: of its messages one would get none."""
    seen: dict[str, str] = {}
    for name in _TOPICS:
        topic = values.get(name)
        if topic in seen:
            allowed = f"another topic than that of {seen[topic]}"
            raise wrong(text, name, topic, allowed)
        if topic is not None:
            seen[topic] = name


def wrong(text: str, name: str, value: str, allowed: str) -> SettingError:
    """The error for a part of an address, with what is allowed."""
    return SettingError(
        f"{name} = {value!r} in address {text!r} is not valid; it must be {allowed}"
    )
