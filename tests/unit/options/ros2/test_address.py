"""`ros2://` addresses: what they say, and what is told about wrong ones."""

from __future__ import annotations

import pytest

from options.ros2.address import parse
from swarm.errors import SettingError
from swarm.geometry import Pose

ODOM = "ros2://10.0.0.7/0?points=/points&odom=/odom"


def test_an_address_names_the_router_the_domain_and_the_topics() -> None:
    address = parse("ros2://robot1.lan:7500/42?points=/front/points&tf=/R1/tf")
    assert (address.router, address.domain) == ("tcp/robot1.lan:7500", 42)
    assert (address.points, address.odom) == ("/front/points", "")
    assert (address.tf, address.tf_static) == ("/R1/tf", "/R1/tf_static")


def test_what_an_address_leaves_out_has_defaults() -> None:
    address = parse("ros2://[fd00::1]?points=/p&odom=/o")
    assert (address.router, address.domain) == ("tcp/[fd00::1]:7447", 0)
    assert (address.tf_static, address.sensor, address.origin) == (
        "/tf_static",
        None,
        Pose(0, 0, 0),
    )
    assert (address.detector, address.rate, address.max_age) == ("factory", 10.0, 0.5)
    assert address.stamps == "header"


def test_options_say_how_the_robot_is_read() -> None:
    address = parse(
        f"{ODOM}&sensor=0.2,0,1.2&origin=4,5,0,0,0,1.5&detector=road&rate=5&max_age=1&stamps=arrival"
    )
    assert address.sensor == Pose(0.2, 0, 1.2)
    assert address.origin == Pose(4, 5, 0, yaw=1.5)
    assert (address.detector, address.rate, address.max_age_ns) == ("road", 5.0, 10**9)
    assert address.stamps == "arrival"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tcp/10.0.0.7:7447", r"'tcp/10.0.0.7:7447' is not valid; it must be ros2://HOST"),
        ("http://10.0.0.7/0?points=/p&odom=/o", "must be ros2://HOST"),
        ("ros2:///0?points=/p&odom=/o", "must be ros2://HOST"),
        ("ros2://10.0.0.7:99999/0?points=/p&odom=/o", "Port out of range"),
        ("ros2://10.0.0.7:0/0?points=/p&odom=/o", "port = '0' in .* a TCP port from 1 to 65535"),
        (f"ros2://10.0.0.7/{'1' * 5000}?points=/p&odom=/o", "domain = '1+' in .* ROS_DOMAIN_ID"),
        ("ros2://10.0.0.7/233?points=/p&odom=/o", "domain = '233' in .* ROS_DOMAIN_ID from 0 to"),
        ("ros2://10.0.0.7/lab?points=/p&odom=/o", "domain = 'lab'"),
        ("ros2://10.0.0.7/0", r"lacks points=/TOPIC"),
        ("ros2://10.0.0.7/0?points", "not valid: bad query field"),
        ("ros2://10.0.0.7/0?points=/p", r"must name one topic that says where the robot is: odom="),
        ("ros2://10.0.0.7/0?points=/p&odom=/o&tf=/tf", "must name one topic that says where"),
        ("ros2://10.0.0.7/0?points=/p&points=/q&odom=/o", "gives 'points' twice"),
        ("ros2://10.0.0.7/0?points=p&odom=/o", "points = 'p' in .* a topic's full name, like /li"),
        ("ros2://10.0.0.7/0?points=/a/*&odom=/o", r"points = '/a/\*' in"),
        ("ros2://10.0.0.7/0?points=/p&odom=/p", "odom = '/p' in .* another topic than that of poi"),
        ("ros2://10.0.0.7/0?points=/p&tf=/tf&tf_static=/tf", "tf_static = '/tf' .* that of tf"),
        ("ros2://10.0.0.7/0?points=/tf_static&odom=/o", "tf_static = '/tf_static' .* of points"),
        (f"{ODOM}&speed=3", "has the option 'speed'; allowed: points, odom, tf, tf_static, sensor"),
        (f"{ODOM}&host=x", "has the option 'host'|gives 'host' twice"),
        (f"{ODOM}&sensor=1,2", "sensor = '1,2' in .* must be x,y,z or x,y,z,roll,pitch,yaw"),
        (f"{ODOM}&origin=0,0,nan", "origin = '0,0,nan' in"),
        (f"{ODOM}&origin=1e300,0,0", "origin = '1e300,0,0' in .* from -10000000 to 10000000"),
        (f"{ODOM}&sensor=0,0,-1e8", "sensor = '0,0,-1e8' in .* from -10000000 to 10000000"),
        (f"{ODOM}&detector=moon", "detector = 'moon' in .* must be factory or road"),
        (f"{ODOM}&rate=0", "rate = '0' in .* must be frames a second > 0 and <= 100"),
        (f"{ODOM}&max_age=inf", "max_age = 'inf' in .* must be seconds > 0 and <= 60"),
        (f"{ODOM}&stamps=mine", "stamps = 'mine' in .* must be header or arrival"),
    ],
)
def test_what_is_wrong_with_an_address_is_named(text: str, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        parse(text)
