"""Removes what a killed controller left of links that are gone.

`python -m network_controller.sweep`: only `ifb` devices outlive their link, everything else goes
with it.
"""

from __future__ import annotations

import socket
import sys

from network_controller.drivers.command import run
from network_controller.drivers.ifbs import orphans
from swarm.errors import NetworkError


def main() -> int:
    """Removes them; 1 when that is not allowed here."""
    try:
        for device in orphans([name for _, name in socket.if_nameindex()]):
            run("ip", "link", "del", device)
    except NetworkError as error:
        print(f"network_controller.sweep: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
