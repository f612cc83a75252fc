"""The page reads a recorded link as the command line does."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from network_controller.mahimahi import read_trace
from options.console.app import PAGE
from research.benchmarks import browser as chromium

Read = Callable[[str], object]
READ = """async ([module, text]) => {
  const { rates } = await import(module);
  try { return rates(text); }
  catch (error) { return error.message; }
}"""


@pytest.fixture(scope="module")
def read() -> Iterator[Read]:
    """What the page's own module makes of a trace: rates, or the words of its refusal."""
    if (missing := chromium.why_not()) is not None:
        pytest.skip(missing)
    module = base64.b64encode((PAGE / "mahimahi.js").read_bytes()).decode()
    with chromium.browser() as browser:
        page = browser.new_page()
        yield lambda text: page.evaluate(READ, [f"data:text/javascript;base64,{module}", text])


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
def test_the_rates_are_those_of_the_command_line(
    times: list[int], read: Read, tmp_path: Path
) -> None:
    text = "".join(f"{time}\n" for time in times)
    file = tmp_path / "trace"
    file.write_text(text)
    found = read(text)
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
def test_what_is_no_trace_is_named(text: str, words: str, read: Read) -> None:
    assert words in str(read(text))
