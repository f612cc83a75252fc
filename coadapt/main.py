"""The command line's dispatcher: one subcommand a module of `coadapt.commands`."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from coadapt import commands
from swarm.errors import CoAdaptError, not_installed
from swarm.memory import keep_freed_memory
from swarm.process import leave
from swarm.version import installed_version

RESEARCH = "research"
"""The package that an installed wheel leaves out."""


def build_parser(command: str = "") -> argparse.ArgumentParser:
    """The parser with every module of `coadapt.commands` registered on it; with that of `command`
    alone, where there is one: what the others import takes most of a second."""
    parser = argparse.ArgumentParser(
        prog="coadapt",
        description="Adaptive collaborative perception for robot swarms.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and end")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    modules = sorted(m.name for m in pkgutil.iter_modules(commands.__path__))
    named = [module for module in modules if module == command.replace("-", "_")]
    for module in named or modules:
        importlib.import_module(f"coadapt.commands.{module}").register(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit status: 0, or 1 after an error on standard error.

    Wrong usage exits with 2 (argparse).
    """
    keep_freed_memory()
    words = list(sys.argv[1:] if argv is None else argv)
    args = build_parser(words[0] if words else "").parse_args(words)
    try:
        return int(args.run(args) or 0)
    except CoAdaptError as error:
        print(f"coadapt: {error}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if importlib.util.find_spec(package) is not None:
            raise
        if package == RESEARCH:
            text = (
                "the experiments are not in this installation: this command needs the package "
                f"`{RESEARCH}`; run it in a checkout of the repository, after `make setup`"
            )
        else:
            text = not_installed(package)
        print(f"coadapt: {text}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1
    except KeyboardInterrupt:
        return 130


def command() -> NoReturn:
    """What `coadapt` runs: one command, and the end of the process.

    It ends at once: Python aborts where it tears itself down while Zenoh, which may take seconds to
    close on a busy machine, still calls back.
    """
    leave(main())


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        version = installed_version() or "(sources that are not installed)"
        print(f"coadapt {version}")
        parser.exit()


if __name__ == "__main__":
    command()
