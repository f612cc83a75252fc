"""The rate of the ego's link, on a real device in a namespace of the test's own."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from deploy.netns import launch

_refused = launch.why_not()
pytestmark = pytest.mark.skipif(_refused is not None, reason=str(_refused))

SHAPE = """
import json, subprocess, sys
from deploy.netns import link
from swarm.errors import DeployError

subprocess.run(["ip", "link", "add", "name", "near", "type", "veth", "peer", "name", "far"],
               check=True)
for device in ("near", "far"):
    subprocess.run(["ip", "link", "set", device, "up"], check=True)
def shown(what):
    return subprocess.run(["tc", what, "show", "dev", "near"], capture_output=True, text=True,
                          check=True).stdout
states = []
for rate in json.loads(sys.argv[1]):
    link.shape("near", rate)
    states.append([shown("class"), shown("filter")])
print(json.dumps(states))
"""


def shaped(*rates: int) -> list[list[str]]:
    """tc's classes and filters after each rate was set on one device."""
    done = subprocess.run(
        [
            *("unshare", "--user", "--map-root-user", "--net"),
            *(sys.executable, "-c", SHAPE, json.dumps(rates)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    states: list[list[str]] = json.loads(done.stdout)
    return states


def test_every_class_may_use_the_whole_rate_and_is_found_by_its_mark() -> None:
    [[classes, filters]] = shaped(20_000_000)
    assert classes.count("ceil 20Mbit") == 4
    assert "rate 16Mbit" in classes
    for mark in ("00b80000", "00880000", "00200000"):
        assert mark in filters


def test_the_rate_changes_while_the_device_is_in_use() -> None:
    before, low, back = shaped(55_000_000, 750_000, 55_000_000)
    assert low[0].count("ceil 750Kbit") == 4
    assert back == before
