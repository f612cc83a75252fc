"""`python -m research.chaos.outsider ATTACK ...`: attacks until its input is closed.

Prints what it did and how many sessions the router took (JSON)."""

from __future__ import annotations

import argparse
import json
import random
import sys
import threading

from research.chaos.outsider import crowd, floods, lies
from research.chaos.outsider.place import Place
from swarm.errors import CoAdaptError
from swarm.process import leave

ATTACKS = {**crowd.ATTACKS, **lies.ATTACKS, **floods.ATTACKS}


def main() -> int:
    """Attacks; 1 where that was not possible."""
    parser = argparse.ArgumentParser(prog="python -m research.chaos.outsider", description=__doc__)
    parser.add_argument("attack", choices=sorted(ATTACKS))
    parser.add_argument("--router", required=True)
    parser.add_argument("--swarm", required=True)
    parser.add_argument("--robots", required=True, help="by commas, the ego first")
    parser.add_argument("--target", default="")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    stop = threading.Event()

    def watch() -> None:
        sys.stdin.read()
        stop.set()

    threading.Thread(target=watch, daemon=True).start()
    place = Place(
        router=args.router,
        swarm=args.swarm,
        robots=tuple(args.robots.split(",")),
        target=args.target,
        chance=random.Random(args.seed),
        stop=stop,
    )
    try:
        said = {"did": ATTACKS[args.attack](place)}
    except CoAdaptError as error:
        said = {"failed": str(error)}
    print(json.dumps(said | {"sessions": len(place.admitted)}))
    return 0 if "did" in said else 1


if __name__ == "__main__":
    leave(main())
