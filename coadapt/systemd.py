"""A systemd unit for a command of the project that runs in the foreground (systemd.service(5))."""

from __future__ import annotations

import getpass
import sys
from collections.abc import Sequence
from pathlib import Path

from deploy.progress import say
from swarm.errors import DeployError
from swarm.files import write_whole

_UNIT = """\
[Unit]
Description=CoAdapt Edge: {what}
Wants=network-online.target
After=network-online.target time-sync.target

[Service]
ExecStart={command}
User={user}
Restart=always
RestartSec=2
TimeoutStopSec=10
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
{more}
[Install]
WantedBy=multi-user.target
"""


def unit(what: str, argv: Sequence[str], reads: Path | None = None, writes: str = "") -> str:
    """The unit's text for `python -m ARGV`, with this installation's Python.

    It runs as the owner of `reads`, a folder with a private key, else as who asks. `writes`: a
    folder that the command writes to, beside its temporary files; empty for none. Raises OSError.
    """
    command = [sys.executable, "-m", *argv]
    return _UNIT.format(
        what=what.replace("%", "%%"),
        command=" ".join(map(_quoted, command)),
        user=reads.owner() if reads is not None else getpass.getuser(),
        more=f"ReadWritePaths={_quoted(writes)}\n" if writes else "",
    )


def print_unit(
    what: str, argv: Sequence[str], reads: Path | None, writes: str, output: Path | None
) -> None:
    """Prints the unit's text, or writes it to a file. Raises DeployError."""
    try:
        text = unit(what, argv, reads, writes)
        if output is None:
            print(text, end="")
            return
        write_whole(output, text)
    except (OSError, KeyError) as error:
        raise DeployError(f"the unit cannot be written: {error}") from error
    say(f"{output}: in /etc/systemd/system, `systemctl enable --now {output.name}` starts it")


def _quoted(word: str) -> str:
    """A word of a command line, where % and $ mean themselves."""
    plain = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{plain}"' if plain != word or not word or set(word) & set(" \t;'") else word
