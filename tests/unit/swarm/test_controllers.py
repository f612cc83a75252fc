"""Several controllers' states, joined: who has which link, and to whom a request goes."""

from __future__ import annotations

from typing import Any

import pytest

from swarm.controllers import FRESH_S, MAX_CONTROLLERS, Controllers, merged
from swarm.errors import NetworkError
from swarm.messages import LinkState, NetState, ShapeInForce, ShapeReply, ShapeRequest

NOW = 100.0


def link(robot: str, capacity_bps: int = 5_000_000) -> LinkState:
    return LinkState(
        robot=robot,
        direction="down",
        capacity_bps=capacity_bps,
        available_bps=capacity_bps,
        latency_ms=0.0,
        level=0,
        classes={},
    )


def state(name: str = "", seq: int = 1, number: int = 1, **fields: Any) -> NetState:
    return NetState(controller=number, seq=seq, sent_ns=0, name=name, **fields)


def heard(*states: NetState, at: float = NOW) -> Controllers:
    controllers = Controllers()
    for one in states:
        controllers.take(one, at)
    return controllers


RATE = ShapeRequest(profile="rate", rate_bps=1_000_000)
TWO = (
    state("hall-1", robots=("R1", "R2"), links=(link("R1"),)),
    state("hall-2", number=2, robots=("R7",), links=(link("R7"),), unshaped=("no NET_ADMIN",)),
)


def test_the_links_of_all_controllers_are_known() -> None:
    both = heard(*TWO)
    assert [one.robot for one in both.links(NOW)] == ["R1", "R7"]
    assert (both.of("R2", NOW), both.of("R7", NOW), both.of("R9", NOW)) == (
        "hall-1",
        "hall-2",
        None,
    )
    assert both.unshaped(NOW) == ("controller hall-2: no NET_ADMIN",)


def test_a_state_without_a_link_does_not_take_another_controllers_link_away() -> None:
    both = heard(*TWO, state("hall-2", seq=2, number=2))
    assert [one.robot for one in both.links(NOW)] == ["R1"]


def test_a_link_that_two_claim_is_the_first_ones_until_that_is_silent() -> None:
    both = heard(TWO[0])
    both.take(state("hall-2", number=2, links=(link("R1", 9_000_000),)), NOW + 1.0)
    assert both.links(NOW + 1.0)[0].capacity_bps == 5_000_000
    late = NOW + FRESH_S + 0.5
    assert both.links(late)[0].capacity_bps == 9_000_000
    assert both.of("R1", late) == "hall-2"


def test_an_older_state_changes_nothing_and_a_new_start_does() -> None:
    one = heard(state("hall-1", seq=5, links=(link("R1"),)), state("hall-1", seq=4))
    assert one.links(NOW)
    one.take(state("hall-1", seq=1, number=9), NOW)
    assert not one.links(NOW)


def test_a_flood_of_names_does_not_grow_without_end() -> None:
    flood = heard(*(state(f"c{number}") for number in range(MAX_CONTROLLERS + 20)))
    assert len(flood.present(NOW)) == MAX_CONTROLLERS


def test_a_request_goes_to_the_controller_that_has_the_link() -> None:
    both = heard(*TWO)
    (asked,) = both.addressees(ShapeRequest(profile="congest", robot="R7"), "R1", NOW).items()
    assert (asked[0], asked[1].robot) == ("hall-2", "R7")
    # The cell: a host's own controller need not know which robot is the ego.
    assert both.addressees(RATE, "R7", NOW)["hall-2"].robot == "R7"
    with pytest.raises(NetworkError, match=r"of robot 'R9': hall-1 has R1, R2; hall-2 has R7"):
        both.addressees(RATE, "R9", NOW)


def test_what_is_for_all_links_goes_to_all() -> None:
    both = heard(*TWO)
    for profile in ("show", "off", "relieve"):
        asked = both.addressees(ShapeRequest(profile=profile), "R1", NOW)
        assert list(asked) == ["hall-1", "hall-2"]
    assert list(both.addressees(ShapeRequest(profile="off", robot="R7"), "R1", NOW)) == ["hall-2"]
    with pytest.raises(NetworkError, match="revisions of its own"):
        both.addressees(ShapeRequest(profile="off", revision=3), "R1", NOW)


@pytest.mark.parametrize("known", [(), (state(),), (state(robots=("R1",)), TWO[1])])
def test_the_controller_without_a_name_is_asked_as_ever(known: tuple[NetState, ...]) -> None:
    assert heard(*known).addressees(RATE, "R1", NOW) == {"": RATE}
    # One of an older version does not tell whose links it has.
    assert list(heard(*known).addressees(RATE, "R5", NOW)) == [""]


def test_replies_of_several_are_one() -> None:
    def reply(robot: str, revision: int) -> ShapeReply:
        shape = ShapeInForce(
            robot=robot,
            direction="down",
            profile="rate",
            rate_bps=1,
            operator="ann",
            since_ns=0,
            until_ns=0,
        )
        return ShapeReply(request=0, revision=revision, shapes=(shape,), notes=("note",))

    one = merged({"hall-1": reply("R1", 4), "hall-2": reply("R7", 9)})
    assert [shape.robot for shape in one.shapes] == ["R1", "R7"]
    assert one.notes == ("controller hall-1: note", "controller hall-2: note")
    alone = reply("R1", 4)
    assert merged({"": alone}) is alone
