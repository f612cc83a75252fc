"""Where fused objects go to: what an address says, and what is wrong with one."""

from __future__ import annotations

import pytest

from options.ros2.output import Target, parse_target
from swarm.errors import SettingError


def test_an_address_says_where_ros_is() -> None:
    assert parse_target("ros2://robot") == Target(host="robot", domain=0)
    full = parse_target("ros2://[::1]:7448/12?prefix=/floor/seen&hashes=no")
    assert full.router == "tcp/[::1]:7448"
    assert (full.domain, full.prefix, full.hashes) == (12, "/floor/seen", False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tcp/robot:7447", r"must be ros2://HOST\[:PORT\]/DOMAIN\[\?prefix"),
        ("ros2://robot:0/1", "port = '0'"),
        ("ros2://robot/233", "domain = '233'"),
        ("ros2://robot/0?prefix=seen", "prefix = 'seen'"),
        ("ros2://robot/0?prefix=/a&prefix=/b", "gives 'prefix' twice"),
        ("ros2://robot/0?hashes=1", "hashes = '1'.*yes, or no for ROS 2 Humble"),
        ("ros2://robot/0?points=/a", "option 'points'; allowed: prefix, hashes"),
    ],
)
def test_what_is_wrong_with_an_address_is_named(text: str, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        parse_target(text)
