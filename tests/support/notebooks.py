"""Runs a notebook's code cells as Jupyter does, without it: one namespace, and what a cell ends
with is shown. `python -m tests.support.notebooks docs/first-hour.ipynb` keeps the outputs anew."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path
from typing import Any


def code_of(cell: dict[str, Any]) -> str:
    """The source of a cell as one text."""
    source = cell["source"]
    return source if isinstance(source, str) else "".join(source)


def code_lines(notebook: dict[str, Any]) -> int:
    """Lines of code in all cells, without those that are empty or a comment."""
    lines = [
        line.strip()
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
        for line in code_of(cell).splitlines()
    ]
    return sum(bool(line) and not line.startswith("#") for line in lines)


def execute(notebook: dict[str, Any]) -> None:
    """Runs all code cells in order, and puts what they show into their outputs."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    count = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        count += 1
        tree = ast.parse(code_of(cell))
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"cell {count}", "exec"), namespace)
        cell["execution_count"] = count
        cell["outputs"] = []
        if isinstance(last, ast.Expr):
            shown = eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), namespace)
            cell["outputs"] = [_output(shown, count)]


def _output(shown: object, count: int) -> dict[str, Any]:
    data: dict[str, Any] = {"text/plain": [repr(shown)]}
    if (svg := getattr(shown, "_repr_svg_", None)) is not None:
        data["image/svg+xml"] = svg().splitlines(keepends=True)
    return {
        "data": data,
        "execution_count": count,
        "metadata": {},
        "output_type": "execute_result",
    }


if __name__ == "__main__":
    file = Path(sys.argv[1])
    kept = json.loads(file.read_text())
    execute(kept)
    file.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n")
