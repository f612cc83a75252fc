"""The page reads a recorded link as the command line does."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from console.app import PAGE
from network_controller.mahimahi import read_trace

READ = """
import { readFileSync } from "node:fs";
import { rates } from "MODULE";
try { console.log(JSON.stringify(rates(readFileSync(0, "utf8")))); }
catch (error) { console.log(JSON.stringify(error.message)); }
"""


def read(text: str, tmp_path: Path) -> object:
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not here: the page's modules cannot be run outside a browser")
    module = tmp_path / "mahimahi.mjs"
    shutil.copy(PAGE / "mahimahi.js", module)
    script = tmp_path / "read.mjs"
    script.write_text(READ.replace("MODULE", module.as_uri()))
    done = subprocess.run([node, script], input=text, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    "times",
    [
        [0, 1, 1, 1000, 1001, 2600],
        [5],
        [400],
        [1400],
        [1500],
        [*range(0, 3000, 7), 3999],
        [0, 9000],
    ],
)
def test_the_rates_are_those_of_the_command_line(times: list[int], tmp_path: Path) -> None:
    text = "".join(f"{time}\n" for time in times)
    file = tmp_path / "trace"
    file.write_text(text)
    found = read(text, tmp_path)
    assert isinstance(found, list)
    assert found == pytest.approx(list(read_trace(file)), abs=1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no trace"),
        ("0\n", "no trace"),
        ("5\n3\n", "line 2"),
        ("1\nfast\n", 'line 2 is "fast"'),
    ],
)
def test_what_is_no_trace_is_named(text: str, words: str, tmp_path: Path) -> None:
    assert words in str(read(text, tmp_path))
