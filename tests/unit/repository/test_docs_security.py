"""docs/security.md shows the rights that the router's rules are written from.

`COADAPT_GOLDEN=write` writes the table anew.
"""

from __future__ import annotations

import os

from swarm.trust.rights import Act, rights_of
from swarm.trust.roles import role_of
from tests.support.paths import REPOSITORY

PAGE = REPOSITORY / "docs" / "security.md"
BEGIN, END = "<!-- rights -->\n", "<!-- /rights -->"
NAMES = (
    "R3",
    "ego-R1",
    "controller",
    "controller-hall-2",
    "gateway",
    "console",
    "operator-ann",
    "reader-bob",
)
ACTS: tuple[Act, ...] = ("put", "listen", "serve", "ask", "hold", "watch")


def table() -> str:
    lines = [f"| role | {' | '.join(ACTS)} |", f"|---|{'---|' * len(ACTS)}"]
    for name in NAMES:
        cells = []
        for act in ACTS:
            keys = [right.key for right in rights_of(role_of(name), "S") if right.act == act]
            cells.append("<br>".join(f"`{key.removeprefix('coadapt/S/')}`" for key in keys))
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n" + "\n".join(lines) + "\n\n"


def test_the_table_of_rights_is_the_one_that_holds() -> None:
    text = PAGE.read_text()
    head, _, rest = text.partition(BEGIN)
    shown, _, tail = rest.partition(END)
    if os.environ.get("COADAPT_GOLDEN") == "write":
        PAGE.write_text(f"{head}{BEGIN}{table()}{END}{tail}")
        return
    assert shown == table()
