"""`coadapt wish`: what people want of a running swarm, read back, confirmed, listed, ended."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import msgspec

from coadapt.arguments import add_ego, add_swarm
from coadapt.elsewhere import add_router, state_of
from coadapt.site import classes_of, site_of
from coadapt.understanding import OTHERWISE
from coadapt.wish_batch import understood_batch
from coadapt.wishes import NOBODY, Egos, Given, check, egos_of, line_of, listed, read_back
from swarm.errors import DecisionError, RefusedError
from swarm.messages import EgoSteered, intent_from_json, intent_to_json
from swarm.messages.intent import MAX_WISH_CHARS


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `wish` to the command line."""
    parser = subparsers.add_parser(
        "wish",
        help="say what matters; it is read back and obeyed once confirmed",
        description=__doc__,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("text", nargs="?", help="the wish, in plain words")
    what.add_argument(
        "--intent", metavar="JSON", help="the intent itself: a JSON object, or a file with one"
    )
    what.add_argument("--list", action="store_true", help="the wishes in force and waiting")
    what.add_argument("--withdraw", type=int, metavar="ID", help="end a wish")
    what.add_argument(
        "--batch",
        type=Path,
        metavar="FILE.jsonl",
        help="understand many, without a swarm: objects of id, wish, robots, places, classes, now",
    )
    parser.add_argument(
        "--site", type=Path, metavar="FILE", help="names of places (default: the swarm's own)"
    )
    parser.add_argument("--now", metavar="ISO", help="the time of the wish (default: now)")
    parser.add_argument("--apply", action="store_true", help="confirm without being asked")
    parser.add_argument(
        "--sure",
        action="store_true",
        help="with --apply: also where words were not clear or nobody is left to ask",
    )
    add_ego(parser)
    add_swarm(parser)
    add_router(parser)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Does what is asked. Raises DecisionError for a wish that cannot be obeyed, GatewayError where
    nobody understands it."""
    if args.batch is not None:
        for line in understood_batch(args.batch):
            print(line, flush=True)
        return 0
    now = _now(args.now)
    state = state_of(args)
    with egos_of(state) as egos:
        if args.list:
            reply = egos.in_force()
            _tell(args, reply.intents, listed(reply))
            return 0
        if args.withdraw is not None:
            reply = _asked(lambda: egos.withdraw(args.withdraw))
            _tell(args, reply.intents, f"wish {args.withdraw} has ended")
            return 0
        named = site_of(args.site, state.spec)
        site = egos.site(named, classes_of(state.spec))
        if args.intent is not None:
            given = Given(intent_from_json(_text(args.intent)), places=named.places)
        else:
            intent = egos.understood(args.text, site, now)
            given = Given(intent, said=args.text[:MAX_WISH_CHARS], places=named.places)
        if given.intent.is_empty() and given.intent.unclear:
            words = "; ".join(map(repr, given.intent.unclear))
            raise DecisionError(f"no wish was understood in {words}; {OTHERWISE}")
        check(given.intent, site, now)
        return _give(args, egos, given)


def _give(args: argparse.Namespace, egos: Egos, given: Given) -> int:
    """Reads an intent back, and confirms it where that is wanted."""
    tried = _asked(lambda: egos.ask("try", given))
    nobody = tried.effect is not None and tried.effect.nobody
    if not args.json:
        print(read_back(given, tried), flush=True)
    if not args.apply and (args.json or not sys.stdin.isatty()):
        _tell(args, _offered(given, tried), "nothing is changed; --apply confirms it")
        return 0
    if args.apply:
        if given.intent.unclear and not args.sure:
            raise DecisionError("words were not clear: say them otherwise, or confirm with --sure")
        if nobody and not args.sure:
            raise DecisionError("it leaves nobody to ask: confirm that, too, with --sure")
    elif not _confirmed("obey it?") or (
        nobody and not _confirmed("nobody is left to ask. Obey it all the same?")
    ):
        print("nothing is changed")
        return 0
    reply = _asked(lambda: egos.ask("confirm-nobody" if nobody else "confirm", given))
    (one,) = [one for one in reply.intents if one.number == reply.number]
    _tell(args, _offered(given, reply), f"{reply.ego} obeys {line_of(one)}")
    return 0


def _offered(given: Given, reply: EgoSteered) -> dict[str, object]:
    return {
        "number": reply.number,
        "intent": intent_to_json(given.intent),
        "effect": msgspec.to_builtins(reply.effect),
    }


def _asked(ask: Callable[[], EgoSteered]) -> EgoSteered:
    try:
        return ask()
    except RefusedError as error:
        if error.code == NOBODY:
            raise DecisionError(f"{error}: --sure") from error
        raise DecisionError(f"the ego refuses: {error}") from error


def _confirmed(question: str) -> bool:
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes", "j", "ja")


def _tell(args: argparse.Namespace, value: object, text: str) -> None:
    print(msgspec.json.encode(value).decode() if args.json else text, flush=True)


def _text(given: str) -> str:
    """An intent's JSON: as it is given, or a file's. Raises DecisionError."""
    if given.lstrip().startswith("{"):
        return given
    try:
        return Path(given).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise DecisionError(
            f"--intent {given[:80]!r} is neither a JSON object nor a file with one: {error}"
        ) from error


def _now(text: str | None) -> datetime:
    if text is None:
        return datetime.now().astimezone()
    try:
        now = datetime.fromisoformat(text)
    except ValueError as error:
        raise DecisionError(f"--now {text!r} is not a time; allowed: ISO 8601") from error
    return now if now.tzinfo is not None else now.astimezone()
