"""Addresses and links of a swarm in network namespaces: a bridge, and one namespace a robot.

The bridge and Prometheus lie in the supervisor's own namespace (host `infra`); a robot's namespace
reaches the bridge through its `eth0`, whose other end is `link_name` in the supervisor's.
"""

from __future__ import annotations

import subprocess

from deploy.roster import INFRA
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

BRIDGE = "coadapt0"
BRIDGE_ADDRESS = "10.77.0.1"
PREFIX_LENGTH = 16
NAMESPACES = "/run/netns"
_HOSTS_A_BLOCK = 250


def address(spec: SwarmSpec, host: str) -> str:
    """The IPv4 address of a host: the bridge's for `infra`, else one by the robot's place."""
    if host == INFRA:
        return BRIDGE_ADDRESS
    index = _index(spec, host)
    return f"10.77.{1 + index // _HOSTS_A_BLOCK}.{1 + index % _HOSTS_A_BLOCK}"


def link_name(spec: SwarmSpec, host: str) -> str:
    """The bridge's end of a robot's link; what leaves through it goes to the robot."""
    return f"link{_index(spec, host) + 1}"


def enter(host: str) -> tuple[str, ...]:
    """What to put before a command so that it runs in a host's namespace."""
    return () if host == INFRA else ("nsenter", f"--net={NAMESPACES}/{host}")


def build(spec: SwarmSpec) -> None:
    """Makes the bridge and the robots' namespaces and links.

    Call it as root of new network and mount namespaces: all of it goes with them. Raises
    DeployError with the words of the command that failed.
    """
    # `ip netns` keeps its names in /run, which an ordinary user cannot write.
    run("mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", "/run")
    lines = [
        "link set lo up",
        f"link add {BRIDGE} type bridge",
        f"addr add {BRIDGE_ADDRESS}/{PREFIX_LENGTH} dev {BRIDGE}",
        f"link set {BRIDGE} up",
    ]
    for robot in spec.robots:
        link = link_name(spec, robot)
        lines += [
            f"netns add {robot}",
            f"link add {link} type veth peer name eth0 netns {robot}",
            f"link set {link} master {BRIDGE} up",
        ]
    run("ip", "-batch", "-", text="\n".join(lines))
    for robot in spec.robots:
        inside = [
            "link set lo up",
            f"addr add {address(spec, robot)}/{PREFIX_LENGTH} dev eth0",
            "link set eth0 up",
        ]
        run("ip", "-n", robot, "-batch", "-", text="\n".join(inside))


def run(*argv: str, text: str = "") -> str:
    """The output of a short command. Raises DeployError with its own words when it fails."""
    try:
        done = subprocess.run(argv, input=text, capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeployError(f"{' '.join(argv)} cannot be run: {error}") from error
    if done.returncode != 0:
        words = (done.stderr or done.stdout).strip()
        raise DeployError(f"{' '.join(argv)} failed: {words}")
    return done.stdout


def _index(spec: SwarmSpec, host: str) -> int:
    try:
        return spec.robots.index(host)
    except ValueError:
        raise DeployError(
            f"host {host!r} is not one of {INFRA}, {', '.join(spec.robots)}"
        ) from None
