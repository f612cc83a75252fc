"""`coadapt data`: bring the public OPV2V sample here."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

DATASET = "OPV2V, UCLA Mobility Lab, https://mobility-lab.seas.ucla.edu/opv2v/"


def register(commands: Any) -> None:
    """Adds `data` to the subparsers of `coadapt`."""
    from coadapt.sample_source import Source

    source = Source()
    parser = commands.add_parser(
        "data",
        help="bring the public OPV2V sample",
        description="Brings the OPV2V scenario that CoAdapt's own repository carries (2 vehicles, "
        "229 MB; about 80 MB to download) by git, checks it, and puts it where `up --world opv2v`, "
        "`ap`, `fuse` and the tests find it: $COADAPT_DATA, else var/data. Does nothing where it "
        "is already.",
    )
    parser.add_argument(
        "--url",
        default=source.url,
        help="a repository of the same shape (default: %(default)s)",
    )
    parser.add_argument(
        "--commit", default=source.commit, metavar="HASH", help="default: %(default)s"
    )
    parser.add_argument(
        "--tree",
        default=source.tree,
        metavar="HASH",
        help="the git tree that the scenario's folder must have (default: %(default)s)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Brings and checks it. Raises WorldError with what to do."""
    from coadapt.sample_source import Source, bring, place_in, read_all
    from deploy.progress import say, typed
    from worlds.sample import data_home

    home = data_home()
    place = place_in(home)
    say(f"the sample of OPV2V: from {args.url}, unless it is in {home} already ...")
    brought = bring(Source(args.url, args.commit, args.tree), home)
    world = read_all(place)
    size = sum(path.stat().st_size for path in place.rglob("*.pcd"))
    print(f"{'brought  ' if brought else 'there    '} {place}")
    print(
        f"holds     vehicles {', '.join(world.robots)}; {world.frame_count} frames; "
        f"{size / 1e6:.1f} MB of scans, all readable"
    )
    _print_source(place)
    print(f"next      {typed('up', world='opv2v')}")
    return 0


def _print_source(place: Path) -> None:
    from coadapt.sample_source import LICENCE, facts_of

    facts = facts_of(place)
    if facts is None:
        print("source    put there by hand: not compared with a repository")
    else:
        print(f"source    {facts['url']}, {facts['folder']} at {facts['commit']}")
    if (place / LICENCE).is_file():
        licence = (place / LICENCE).read_text(errors="replace").strip().splitlines() or [""]
        owner = next((line for line in licence if line.startswith("Copyright")), "")
        print(f"licence   {licence[0]}, {owner} ({place / LICENCE})")
    print(f"recorded  {DATASET}")
