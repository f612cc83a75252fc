"""From a device's identifiers to the robot whose link it is."""

from __future__ import annotations

from msgspec import UNSET, UnsetType

from network_controller.qod import problems
from network_controller.qod.messages import Device
from network_controller.qod.network import Network


def identified(device: Device | UnsetType) -> Device:
    """The device with the one identifier that is used here. Raises Problem for none."""
    if device is UNSET:
        raise problems.missing_device()
    if device.ipv4_address is UNSET:
        raise problems.unsupported_device()
    return Device(ipv4_address=device.ipv4_address)


def find(network: Network, device: Device) -> str | None:
    """The robot that an identified device is, or None. Raises NetworkError."""
    if device.ipv4_address is UNSET:
        return None
    for address in device.ipv4_address.addresses:
        robot = network.robot_at(address)
        if robot is not None:
            return robot
    return None


def link_of(network: Network, device: Device) -> tuple[str, int]:
    """An identified device's robot and its link's capacity, bit/s.

    Raises Problem when nobody has the address or nothing can be promised, and NetworkError.
    """
    robot = find(network, device)
    if robot is None:
        raise problems.unknown_device("nobody in this swarm has the device's address")
    capacity_bps = network.capacity_bps(robot)
    if capacity_bps is None:
        raise problems.not_applicable(
            f"the link towards {robot} is not shaped, so nothing can be promised on it"
        )
    return robot, capacity_bps
