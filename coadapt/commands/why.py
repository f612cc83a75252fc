"""`coadapt why`: why a decision was made, and what would have been chosen otherwise."""

from __future__ import annotations

import argparse
import json
import sys
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from coadapt.arguments import add_ego, add_swarm, at_least_one
from deploy.paths import journal_path
from deploy.state import need_state, seen_by
from swarm.errors import DeployError, TransportError
from swarm.http.asking import ask

if TYPE_CHECKING:
    from ego_agent.knowledge.why import Explanation, Found

GATEWAY = "the running swarm's"
ANSWER_S = 60.0
MAX_TOKENS = 600
MAX_BYTES = 1_000_000


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `why` to the command line."""
    parser = subparsers.add_parser("why", help="why a decision was made", description=__doc__)
    parser.add_argument("--cycle", type=at_least_one, metavar="N", help="(default: the newest)")
    parser.add_argument(
        "--journal", type=Path, metavar="FILE", help="of a swarm that has ended, or runs elsewhere"
    )
    parser.add_argument(
        "--phrase",
        nargs="?",
        const=GATEWAY,
        metavar="URL",
        help="in a language model's words, if all its numbers and names are true; by the LLM "
        "gateway, or any OpenAI-compatible server at that URL",
    )
    add_ego(parser)
    add_swarm(parser)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the explanation. Raises JournalError where the journal cannot be read or holds no such
    cycle, DeployError where no swarm runs and no journal is named."""
    from ego_agent.knowledge.journal import read_journal
    from ego_agent.knowledge.why import explain, find

    path = args.journal or _running(args)
    found = find(read_journal(path), args.cycle)
    explanation = explain(found)
    phrased = _phrased(args, found, explanation) if args.phrase else ""
    if args.json:
        report = msgspec.to_builtins(explanation)
        print(json.dumps({**report, "phrased": phrased} if args.phrase else report))
    else:
        print(phrased or explanation.text())
    return 0


def _running(args: argparse.Namespace) -> Path:
    state = seen_by(need_state(args.swarm), args.ego)
    return Path(journal_path(state.spec, state.spec.var_dir))


def _phrased(args: argparse.Namespace, found: Found, explanation: Explanation) -> str:
    """A model's words for it; nothing where there are none or they are not true, and why that is on
    standard error."""
    from ego_agent.knowledge.why.phrase import fault, known_names, question

    url = args.phrase
    if url == GATEWAY:
        state = need_state(args.swarm)
        if not state.llm_url:
            raise DeployError(f"swarm {args.swarm!r} runs without a language model")
        url = state.llm_url
    try:
        words = _asked(url, [msgspec.to_builtins(message) for message in question(explanation)])
    except (TransportError, ValueError, KeyError, IndexError, TypeError) as error:
        print(f"coadapt: no words of a model: {url}: {error}", file=sys.stderr)
        return ""
    if wrong := fault(words, explanation, known_names(found)):
        print(f"coadapt: a model's words are dropped: {wrong}", file=sys.stderr)
        return ""
    return words


def _asked(url: str, messages: list[dict[str, str]]) -> str:
    """The answer of an OpenAI-compatible server."""
    body = json.dumps({"messages": messages, "max_tokens": MAX_TOKENS, "temperature": 0}).encode()
    status, raw = ask(
        f"{url.rstrip('/').removesuffix('/v1')}/v1/chat/completions",
        body=body,
        headers={"Content-Type": "application/json"},
        timeout_s=ANSWER_S,
        most_bytes=MAX_BYTES,
    )
    if status != HTTPStatus.OK:
        raise TransportError(f"HTTP status {status}: {raw[:200].decode(errors='replace')}")
    return str(json.loads(raw)["choices"][0]["message"]["content"]).strip()
