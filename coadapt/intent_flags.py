"""The fields of an intent as flags, for whom no language model understands words."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from coadapt.arguments import comma_separated
from swarm.messages import Intent, intent_from_json

FLAGS = (
    "--exclude --prefer --only --focus --class --q-min --link-share --save --policy --from --until"
)
"""Those of `coadapt steer`, for error messages."""


def add_intent(parser: argparse.ArgumentParser) -> None:
    """Adds the flags that make an intent. With one of them, --q-min and --policy belong to it, too:
    they end with it."""
    group = parser.add_argument_group(
        "a wish, by its fields",
        "obeyed until it ends or `coadapt wish --withdraw ID`; with one of these, --q-min and "
        "--policy are part of it",
    )
    for option, words in (
        ("--exclude", "not to be asked"),
        ("--prefer", "to be asked where others would be as good"),
        ("--only", "who alone may be asked; empty: nobody"),
    ):
        group.add_argument(option, metavar="ROBOTS", type=comma_separated, help=words)
    for option, name in (("--focus", "PLACE"), ("--class", "CLASS")):
        group.add_argument(
            option,
            dest=option.lstrip("-").replace("class", "classes"),
            action="append",
            type=_weighed,
            metavar=f"{name}[=high|low]",
            help="what counts more, or less (repeatable)",
        )
    group.add_argument(
        "--link-share", type=float, metavar="SHARE", help="of the link, above 0 to 1"
    )
    group.add_argument("--save", choices=("bandwidth", "compute"), help="what is to cost more")
    group.add_argument("--from", dest="begin", metavar="ISO", help="when it begins (default: now)")
    group.add_argument("--until", metavar="ISO", help="when it ends (default: never)")
    group.add_argument(
        "--site", type=Path, metavar="FILE", help="names of places (default: the swarm's own)"
    )


def intent_of(args: argparse.Namespace) -> Intent | None:
    """The intent of the flags; None where none of them is given.

    Raises MessageError for a value that is not allowed.
    """
    fields: dict[str, Any] = {
        "exclude": args.exclude,
        "prefer": args.prefer,
        "only": args.only,
        "focus": args.focus and [{"place": name, "weight": weight} for name, weight in args.focus],
        "classes": args.classes and dict(args.classes),
        "link_share": args.link_share,
        "save": args.save,
        "start": args.begin,
        "until": args.until,
    }
    given = {name: value for name, value in fields.items() if value is not None}
    if not given:
        return None
    return intent_from_json({**given, "q_min": args.q_min, "policy": args.policy})


def _weighed(text: str) -> tuple[str, str]:
    """`docks=high` as a name and a weight; `docks` counts more."""
    name, _, weight = text.partition("=")
    if weight not in ("", "high", "low") or not name:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME, NAME=high or NAME=low")
    return name, weight or "high"
