"""Links between namespaces that the tests of a folder shape."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from network_controller.model import DIRECTIONS, Link
from tests.support.link_support import Links, links


@pytest.fixture(scope="module")
def stage() -> Iterator[Links]:
    with links(3) as made:
        yield made


@pytest.fixture
def net(stage: Links) -> Iterator[Links]:
    yield stage
    for robot in stage.robots:
        for direction in DIRECTIONS:
            stage.driver.clear(Link(robot, direction))
