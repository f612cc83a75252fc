"""Skips: allowed on a bare machine, and failures where nothing may be missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.support.paths import REPOSITORY

TEST = """
def test_it() -> None:
    pytest.skip("no tool")
"""
MODULE = """
pytest.skip("no tool", allow_module_level=True)

def test_it() -> None:
    raise AssertionError
"""
IMPORTED = MODULE.replace(MODULE.splitlines()[1], 'pytest.importorskip("no_such_module")')
FILES = {
    f"{name}{of}": f"import pytest\n{mark}{code}"
    for of, mark in (("", ""), ("_of_peer", "pytestmark = pytest.mark.peer\n"))
    for name, code in (("test", TEST), ("module", MODULE), ("imported", IMPORTED))
} | {"module_of_peers": f"import pytest\npytestmark = [pytest.mark.peer]\n{MODULE}"}


def outcomes(folder: Path, require: str) -> tuple[dict[str, int], str]:
    """How many tests ended how, and what was said of them."""
    for name, code in FILES.items():
        (folder / f"test_{name}.py").write_text(code)
    command = [sys.executable, "-m", "pytest", "-c", "pyproject.toml", "--rootdir", str(REPOSITORY)]
    command += ["-p", "tests.conftest", "-p", "no:cacheprovider", "--continue-on-collection-errors"]
    done = subprocess.run(
        [*command, f"--summary={folder / 'summary.json'}", str(folder)],
        cwd=REPOSITORY,
        env={**os.environ, "COADAPT_REQUIRE": require},
        capture_output=True,
        text=True,
    )
    counts = json.loads((folder / "summary.json").read_text())
    del counts["seconds"]
    return counts, done.stdout


def test_on_a_bare_machine_tests_and_whole_modules_may_skip(tmp_path: Path) -> None:
    counts, said = outcomes(tmp_path, "")
    assert counts == {"passed": 0, "failed": 0, "skipped": len(FILES)}, said


def test_where_nothing_may_be_missing_only_what_is_of_a_peer_may_skip(tmp_path: Path) -> None:
    counts, said = outcomes(tmp_path, "all")
    ours = [name for name in FILES if "peer" not in name]
    assert counts == {"passed": 0, "failed": len(ours), "skipped": len(FILES) - len(ours)}, said
    for name in ours:
        assert any(
            line.startswith(("FAILED", "ERROR")) and f"test_{name}.py" in line
            for line in said.splitlines()
        ), said
    assert "skipped where nothing may be missing" in said
