"""Where several robots decide, each page shows the ego that it asks for."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from swarm import keyspace
from swarm.messages import EgoSteered, EgoSteering
from tests.support.console_swarm import EGO, Speakers, Viewer, ask, console
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker

OTHER = "R4"


@pytest.fixture
def port(shared_router: RouterProcess, swarm_name: str) -> Iterator[int]:
    with console(shared_router.address, swarm_name, egos=(EGO, OTHER)) as port:
        yield port


def test_two_pages_show_two_egos(
    port: int, shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    speakers = Speakers(open_session(shared_router.address))
    with Viewer(port) as first, Viewer(port, OTHER) as other:
        cycle = 0

        def told() -> bool:
            nonlocal cycle
            cycle += 1
            # Published again until both subscriptions have reached the publisher.
            speakers.decision(cycle, EGO, "R2")
            speakers.decision(cycle, OTHER, "R3", ego=OTHER)
            other.next()
            return "decision" in first.state and "decision" in other.state

        first.until(told, "both pages show a decision")
        assert first.state["about"]["egos"] == other.state["about"]["egos"] == [EGO, OTHER]
        assert first.state["swarm"]["ego"] == EGO
        assert first.state["decision"]["participants"] == [EGO, "R2"]
        assert other.state["swarm"]["ego"] == OTHER
        assert other.state["decision"]["participants"] == [OTHER, "R3"]


def test_a_page_steers_the_ego_that_it_shows(
    port: int, shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    session = open_session(shared_router.address)
    asked: list[str] = []

    def serve(ego: str) -> None:
        def answer(request: EgoSteering) -> EgoSteered:
            asked.append(ego)
            return EgoSteered(
                request=request.request,
                ego=ego,
                policy="coverage",
                q_min=0.5,
                policies=("coverage",),
            )

        session.serve(keyspace.ego_steering(session.swarm, ego), EgoSteering, answer)

    serve(EGO)
    serve(OTHER)
    with Viewer(port, OTHER) as page:
        page.until(lambda: page.state["swarm"]["connected"], "the swarm is reached")
        answers = []

        def answered() -> bool:
            answers.append(page.post(f"ego?ego={OTHER}", {"wish": {}}))
            return answers[-1].status == 200

        page.until(answered, "the ego answers")
    assert set(asked) == {OTHER}


def test_a_robot_that_does_not_decide_is_refused(port: int) -> None:
    for path in ("/api/events?ego=R9", "/api/history?ego=R9&span=120"):
        answer = ask(port, "GET", path)
        assert (answer.status, answer.error) == (404, "'R9' is no ego; egos are R1, R4")
