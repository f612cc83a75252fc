"""Three machines, a router on each: who passes whose bytes, how fast one joins, what a cut costs.

The machines are network namespaces on a bridge, with mutual TLS, real routers, robots that
`coadapt join` starts and egos that are started by hand. Ten answers of 1 MB go from C to B: what of
that passes A, and as control what would with A's router as the only one that the others know. Then
a swarm lives on all three; C's cable is pulled for 20 s and put back.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import zenoh

from coadapt.joining import SCOUT
from deploy.progress import say
from ego_agent.knowledge.journal import CycleRecord, read_journal
from research.benchmarks.machines_site import HOSTS, SWARM, Site, device, place, site
from research.benchmarks.report import write_report
from research.benchmarks.sniffing import Sniffer
from research.benchmarks.stage import inside
from swarm import keyspace, transport, zenoh_config
from swarm.messages import Detections
from swarm.traffic import TrafficClass

MESH: Mapping[str, tuple[str, ...]] = {"A": (), "B": ("A",), "C": ("A", "B")}
"""Whom each machine's router names: those that were there before."""
STAR: Mapping[str, tuple[str, ...]] = {"A": (), "B": ("A",), "C": ("A",)}
ANSWERS, ANSWER_BYTES = 10, 1_000_000
CUT_S = 20.0
PERIOD_S = 1.0
WAIT_S = 60.0
LINKED_S = 15
"""Machines' routers have found each other after this."""
SHOWN = 12
LATE = 1.5
"""Decisions that are farther apart than so many periods have a missed one between them."""
ROBOTS = {"R2": "B", "R3": "C", "R5": "B"}
"""Which robot joins on which machine, in this order."""
SCOUTING = ("R5",)
"""Those that are told no address, and look for their machine's router by multicast: that takes a
while of its own, which does not count in `join_s`."""
WORLD = {"world_robots": 6, "world_rings": 16, "comm_range_m": 200.0}


def transfer(site: Site, peers: Mapping[str, tuple[str, ...]]) -> dict[str, int]:
    """Fusion bytes that pass each machine's cable while C's robot answers B's ego. Both sit beside
    the switch here, and reach their routers by B's and C's cables, which carry all twice."""
    names = [f"router-{host}" for host in HOSTS]
    for host in HOSTS:
        site.router(host, peers[host])
    asker = _client(site, "B", "ego-R2")
    robot = _client(site, "C", "R3")
    key = keyspace.observation(SWARM, "R3")
    payload = bytes(ANSWER_BYTES)

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, payload)

    robot.declare_queryable(keyspace.by(key, keyspace.ANY), answer, complete=True)
    asked = keyspace.by(key, "ego-R2")

    def answered() -> bool:
        return any(reply.ok is not None for reply in asker.get(asked, timeout=WAIT_S / 10))

    wait(answered, "B's ego reaches C's robot")
    # The first answers may come through A, while B and C still look for each other.
    for _ in range(LINKED_S if "B" in peers["C"] else 0):
        if _passed(answered, 1)["A"] < 0.01 * ANSWER_BYTES:
            break
        time.sleep(1.0)
    passed = _passed(answered, ANSWERS)
    say(f"fusion bytes on each cable: {passed}")
    transport.close_zenoh(asker)
    transport.close_zenoh(robot)
    site.stop(*names)
    return passed


def _passed(answered: Callable[[], bool], answers: int) -> dict[str, int]:
    """Fusion bytes that pass each machine's cable while so many answers come."""
    with ExitStack() as stack:
        sniffers = {host: Sniffer([device(host)]) for host in HOSTS}
        for sniffer in sniffers.values():
            stack.callback(sniffer.close)
        got = sum(answered() for _ in range(answers))
        if got != answers:
            raise RuntimeError(f"{got} of {answers} answers came")
        time.sleep(0.5)  # what has come may not have been counted yet
        return {host: one.carried(TrafficClass.FUSION) for host, one in sniffers.items()}


def _client(site: Site, host: str, name: str) -> zenoh.Session:
    router = f"{place(host)}#identity={site.identity(name)}"
    return transport.open_zenoh(
        {**zenoh_config.client_config(router), "queries_default_timeout": int(WAIT_S * 1e3)},
        timeout_s=WAIT_S,
    )


class Living:
    """A swarm on the three machines: an ego on A, one on C, robots on B and C."""

    def __init__(self, site: Site, robots: Mapping[str, str]) -> None:
        """`robots` by id: on which machine."""
        self.site = site
        self.robots = dict(robots)
        self.world = {**WORLD, "epoch_ns": time.time_ns()}
        self.join_s: dict[str, float] = {}
        self._came: dict[str, float] = {}

    def start(self) -> None:
        """Returns when both egos have what each robot sends."""
        for host in HOSTS:
            self.site.router(host, MESH[host])
        self.site.ego("A", "R1", self.world, policy="static-early", period_s=PERIOD_S)
        with self.site.observer() as session:
            session.subscribe(
                keyspace.detections(SWARM, "R1"), Detections, lambda heard: self._take(heard)
            )
            wait(lambda: "R1" in self._came, "the ego on A fuses")
            for robot, host in self.robots.items():
                begun = time.monotonic()
                self.site.join(host, robot, SCOUT if robot in SCOUTING else "")
                wait(lambda robot=robot: robot in self._came, f"{robot} contributes")
                took_s = self._came[robot] - begun
                say(f"{robot} contributes after {took_s:.2f} s")
                if robot not in SCOUTING:
                    self.join_s[robot] = took_s
        self.site.ego("C", "R4", self.world, policy="static-early", period_s=PERIOD_S)
        for ego in ("R1", "R4"):
            wait(lambda ego=ego: self.whole(ego), f"ego {ego} has chosen all")

    def _take(self, heard: Detections) -> None:
        now = time.monotonic()
        self._came.setdefault(heard.ego, now)
        for robot, size in heard.bytes.items():
            if size:
                self._came.setdefault(robot, now)

    def cycles(self, ego: str) -> list[CycleRecord]:
        """What an ego has decided so far."""
        path = self.site.folder / f"{ego}.jsonl"
        return list(read_journal(path)) if path.exists() else []

    def whole(self, ego: str) -> bool:
        """Whether its last decision has all robots take part."""
        cycles = self.cycles(ego)
        return bool(cycles) and set(self.robots) <= set(cycles[-1].decision.participants)

    def cut(self, host: str, seconds: float) -> dict[str, Any]:
        """What a machine's cut costs the ego on it and the one on A."""
        cut_ns = time.time_ns()
        say(f"{host} is cut off for {seconds:.0f} s")
        self.site.cut(host)
        time.sleep(seconds)
        self.site.heal(host)
        healed_ns = time.time_ns()
        for ego in ("R1", "R4"):
            wait(lambda ego=ego: self.rejoined(ego, healed_ns) is not None, f"{ego} has all again")
        return {
            ego: {
                "missed": missed(self.cycles(ego), cut_ns, healed_ns),
                "rejoin_cycles": self.rejoined(ego, healed_ns),
                "with_whom": self._alone_with(ego, cut_ns, healed_ns),
                "after": self._after(ego, healed_ns),
            }
            for ego in ("R1", "R4")
        }

    def rejoined(self, ego: str, healed_ns: int) -> int | None:
        """After how many cycles from the healing on an ego chose all again; None: not yet."""
        after = [one for one in self.cycles(ego) if one.started_ns >= healed_ns]
        whole = (
            n
            for n, one in enumerate(after, 1)
            if set(self.robots) <= set(one.decision.participants)
        )
        return next(whole, None)

    def _after(self, ego: str, healed_ns: int) -> list[dict[str, str]]:
        """Whom an ego left out in its first cycles from the healing on, and why."""
        after = [one for one in self.cycles(ego) if one.started_ns >= healed_ns]
        return [dict(one.inputs.excluded) for one in after[:SHOWN]]

    def _alone_with(self, ego: str, cut_ns: int, healed_ns: int) -> list[str]:
        """Whom an ego chose last before the healing."""
        during = [one for one in self.cycles(ego) if cut_ns <= one.started_ns < healed_ns]
        return list(during[-1].decision.participants) if during else []


def missed(cycles: list[CycleRecord], begin_ns: int, end_ns: int) -> int:
    """Cycles that did not come while they should have."""
    times = [one.started_ns for one in cycles if begin_ns - 2e9 * PERIOD_S <= one.started_ns]
    gaps = [(b - a) * 1e-9 / PERIOD_S for a, b in pairwise(times) if a < end_ns]
    return sum(round(gap) - 1 for gap in gaps if gap > LATE)


def wait(condition: Any, what: str, timeout_s: float = WAIT_S) -> None:
    """Raises RuntimeError where it does not come to be."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise RuntimeError(f"not within {timeout_s:.0f} s: {what}")
        time.sleep(0.02)


def live(site: Site, robots: Mapping[str, str], cut_s: float, mtu: int | None) -> dict[str, Any]:
    """The swarm's life and C's cut; with `mtu`, what the robots on B say when no more passes."""
    swarm = Living(site, robots)
    sniffer = Sniffer([device(host) for host in HOSTS])
    swarm.start()
    cut = swarm.cut("C", cut_s)
    marked, kept = sniffer.marked(), sniffer.kept()
    sniffer.close()
    told = ""
    if mtu is not None:
        told = _narrowed(site, mtu)
    return {
        "join_s": swarm.join_s,
        "cut": cut,
        "marked": marked,
        "dscp_kept": kept,
        "narrow": told,
    }


def _narrowed(site: Site, mtu: int) -> str:
    """What A's machine says of B's once full packets vanish on the way from there."""
    site.narrow("B", mtu)
    wait(lambda: "way_stuck" in site.log("router-B"), "B says that its packets vanish")
    lines = [line for line in site.log("router-B").splitlines() if '"way_stuck"' in line]
    return str(json.loads(lines[-1])["why"])


def inner(robots: Mapping[str, str], cut_s: float, mtu: int | None) -> dict[str, Any]:
    """All of it, in namespaces of its own."""
    with (
        tempfile.TemporaryDirectory(prefix="machines-") as folder,
        site(Path(folder), [*robots], ["R1", "R2", "R4"]) as made,
    ):
        try:
            mesh, star = transfer(made, MESH), transfer(made, STAR)
            return {"mesh": mesh, "star": star, **live(made, robots, cut_s, mtu)}
        except BaseException:
            for log in sorted(Path(folder).glob("*.log")):
                print(log.name, log.read_text(errors="replace")[-1500:], file=sys.stderr)
            raise


def main() -> int:
    """Writes build/bench/machines.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--cut", type=float, default=CUT_S, help="seconds (default: %(default)g)")
    parser.add_argument(
        "--mtu", type=int, help="at the end, have B's cable carry no more, and show what B says"
    )
    args = parser.parse_args()
    if args.inside:
        print(json.dumps(inner(ROBOTS, args.cut, args.mtu)))
        return 0
    options = ["--cut", str(args.cut), *(["--mtu", str(args.mtu)] if args.mtu else [])]
    found = inside("research.benchmarks.machines", "--inside", *options)
    cut = found["cut"].values()
    figures = {
        "detour_bytes": found["mesh"]["A"],
        "detour_bytes_star": found["star"]["A"],
        "transfer_bytes": ANSWERS * ANSWER_BYTES,
        "join_s": round(max(found["join_s"].values()), 2),
        "cut_s": args.cut,
        "cut_cycles_missed": sum(ego["missed"] for ego in cut),
        "rejoin_cycles": max(ego["rejoin_cycles"] for ego in cut),
        "dscp_kept": found["dscp_kept"],
    }
    path = write_report("machines", figures, found)
    say(f"{path}: {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
