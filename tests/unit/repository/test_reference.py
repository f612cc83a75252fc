"""`make docs` builds the API reference, and nothing in a docstring or a type makes it warn."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import REPOSITORY


@pytest.mark.slow
def test_the_reference_is_built_without_a_warning(tmp_path: Path) -> None:
    recipe = subprocess.run(
        ["make", "--dry-run", "docs"], cwd=REPOSITORY, capture_output=True, text=True, check=True
    ).stdout
    (line,) = re.findall(r"^.* -m pdoc .*$", recipe, re.MULTILINE)
    command = shlex.split(line.replace("build/docs", str(tmp_path)))
    done = subprocess.run(
        [sys.executable, *command[1:]], cwd=REPOSITORY, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Warn" not in done.stderr
    page = (tmp_path / "perception" / "codec" / "points.html").read_text()
    assert "encode_points" in page
    assert "Raises ScanError" in page
