"""Fitting: marks of worlds are compared fact by fact, and what differs is told in words."""

from __future__ import annotations

import pytest

from swarm.fitting import other_world, read_mark, remark, write_mark

FACTS = {"detector": "factory", "epoch": 10_000_000_000, "robots": 6, "seed": 1}
OWN = write_mark("factory", FACTS)


def test_a_mark_is_read_as_it_was_written() -> None:
    assert read_mark(OWN) == {"world": "factory"} | {k: str(v) for k, v in FACTS.items()}


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (OWN, ""),
        ("", ""),
        (write_mark("road", FACTS), "it lives in another world: road, the ego in factory"),
        (
            write_mark("factory", {**FACTS, "seed": 2, "robots": 7}),
            "it lives in another world: robots 7 (the ego's: 6); seed 2 (the ego's: 1)",
        ),
        (
            write_mark("factory", {**FACTS, "epoch": 2_500_000_000}),
            "it lives in another world: its time runs 7.5 s ahead of the ego's",
        ),
        (
            write_mark("factory", {**FACTS, "epoch": "soon"}),
            "it lives in another world: epoch soon (the ego's: 10000000000)",
        ),
        # A newer program tells more of the same world, an older one less.
        (write_mark("factory", {**FACTS, "walls": 4}), ""),
        (write_mark("factory", {"seed": 1}), ""),
        ("factory nonsense =", ""),
    ],
)
def test_what_differs_between_two_worlds_is_told(other: str, told: str) -> None:
    assert other_world(OWN, other) == told
    assert other_world("", other) == ""


def test_clocks_and_versions_that_differ_are_remarked() -> None:
    assert remark(0.4, "1.0", "1.0") == ""
    assert remark(0.0, "", "1.0") == ""
    assert remark(5.02, "1.0", "1.0") == "its clock is 5.0 s ahead of the ego's (frames still fit)"
    assert remark(-5.02, "1.0", "1.1") == (
        "its clock is 5.0 s behind the ego's (frames still fit); it runs version 1.1, the ego 1.0"
    )
