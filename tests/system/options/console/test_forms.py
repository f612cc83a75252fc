"""What the page's own module makes of who sends what."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from options.console.app import PAGE
from research.benchmarks import browser as chromium

Call = Callable[..., object]
CALL = """async ([module, name, values]) => (await import(module))[name](...values)"""
FORMS = {"early": 2, "late": 1}


@pytest.fixture(scope="module")
def call() -> Iterator[Call]:
    """Calls a function of the module by its name."""
    if (missing := chromium.why_not()) is not None:
        pytest.skip(missing)
    text = base64.b64encode((PAGE / "forms.js").read_bytes()).decode()
    module = f"data:text/javascript;base64,{text}"
    with chromium.browser() as browser:
        page = browser.new_page()
        yield lambda name, *values: page.evaluate(CALL, [module, name, values])


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"algorithm": "early", "robots": 4, "forms": {}}, [["--early", 4]]),
        # The same form at different rates is one colour.
        ({"algorithm": "late", "robots": 4, "forms": {"late": 3}}, [["--late", 4]]),
        ({"algorithm": "intermediate-codebook", "robots": 2}, [["--intermediate", 2]]),
        (
            {"algorithm": "mixed", "robots": 4, "forms": FORMS},
            [["--mixed", 1], ["--early", 2], ["--late", 1]],
        ),
        # Prometheus does not say who sent what.
        ({"algorithm": "mixed", "robots": 4}, [["--mixed", 4]]),
        ({"algorithm": None, "robots": 4}, [["--quiet", 4]]),
    ],
)
def test_each_form_of_the_past_has_its_own_colour(
    entry: dict[str, Any], expected: list[list[Any]], call: Call
) -> None:
    assert call("layers", entry) == expected


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"algorithm": "mixed", "forms": FORMS}, "mixed: 2 early, 1 late"),
        ({"algorithm": "mixed"}, "mixed"),
        ({"algorithm": "early", "forms": {"early": 3}}, "early"),
        ({"algorithm": None}, "–"),
    ],
)
def test_the_past_says_how_many_have_sent_what(
    entry: dict[str, Any], expected: str, call: Call
) -> None:
    assert call("fusedWords", entry) == expected


def test_every_colour_of_a_form_is_defined_for_light_and_dark(call: Call) -> None:
    style = (PAGE / "console.css").read_text()
    for name in ("early", "intermediate", "late", "mixed"):
        colour = call("algorithmColour", name)
        assert style.count(f"{colour}:") == 2, colour
