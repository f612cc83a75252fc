"""The network controllers of a swarm, one a host, as their states tell of them.

A link has one controller: the first that told of it, as long as it goes on to.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping

import msgspec

from swarm.errors import NetworkError
from swarm.messages import LinkState, NetState, ShapeReply, ShapeRequest

FRESH_S = 3.5
"""Three states' time and some: a controller that has been silent for so long is away."""
MAX_CONTROLLERS = 64
"""Whose states are kept; the longest unheard is dropped."""


def means_all(request: ShapeRequest) -> bool:
    """Whether a request is for every link, whoever has it."""
    return request.profile == "show" or (
        request.profile in ("off", "relieve") and not request.robot
    )


def merged(replies: Mapping[str, ShapeReply]) -> ShapeReply:
    """The replies of several controllers as one; its revision is the first one's."""
    first = next(iter(replies.values()))
    if len(replies) == 1:
        return first
    return msgspec.structs.replace(
        first,
        shapes=tuple(shape for reply in replies.values() for shape in reply.shapes),
        congested=tuple(robot for reply in replies.values() for robot in reply.congested),
        notes=tuple(f"{of(n)}{note}" for n, reply in replies.items() for note in reply.notes),
    )


def of(controller: str) -> str:
    """How a line begins that one controller of several says."""
    return f"controller {controller}: " if controller else ""


class Controllers:
    """Joins the states of several controllers. Not thread-safe; times are steady seconds."""

    def __init__(self) -> None:
        self._states: OrderedDict[str, tuple[NetState, float]] = OrderedDict()

    def take(self, state: NetState, now_s: float) -> None:
        """Takes a state in; an older one of the same controller is dropped."""
        before, _ = self._states.get(state.name, (None, 0.0))
        if before is not None and before.controller == state.controller and state.seq <= before.seq:
            return
        self._states[state.name] = (state, now_s)
        while len(self._states) > MAX_CONTROLLERS:
            oldest = min(self._states, key=lambda name: self._states[name][1])
            del self._states[oldest]

    def present(self, now_s: float) -> Mapping[str, NetState]:
        """The newest state of each controller that is there, by name, in the order in which they
        were heard first."""
        return {name: state for name, (state, at) in self._states.items() if now_s - at <= FRESH_S}

    def links(self, now_s: float) -> tuple[LinkState, ...]:
        """All shaped links of the swarm."""
        found: dict[tuple[str, str], LinkState] = {}
        for state in self.present(now_s).values():
            for link in state.links:
                found.setdefault((link.robot, link.direction), link)
        return tuple(found[key] for key in sorted(found))

    def of(self, robot: str, now_s: float) -> str | None:
        """The name of the controller that has a robot's link; None where none says so."""
        for name, state in self.present(now_s).items():
            if robot in state.robots or any(link.robot == robot for link in state.links):
                return name
        return None

    def addressees(
        self, request: ShapeRequest, ego: str, now_s: float
    ) -> Mapping[str, ShapeRequest]:
        """Which controllers a request goes to, and as what: the one that has the link, or all where
        all links are meant. `ego`: whose link downwards is the cell.

        Raises NetworkError for a robot of which no controller has a link, and for a revision where
        several would have to have it.
        """
        names = list(self.present(now_s)) or [""]
        if means_all(request):
            if request.revision is not None and len(names) > 1:
                raise NetworkError(
                    "each controller counts revisions of its own, and there are "
                    f"{', '.join(map(repr, names))}: name a robot"
                )
            return dict.fromkeys(names, request)
        robot = request.robot or ego
        name = self.of(robot, now_s)
        if name:
            return {name: msgspec.structs.replace(request, robot=robot)}
        if name is None and "" not in names:
            states = self.present(now_s).values()
            have = "; ".join(f"{s.name} has {', '.join(s.robots) or 'none'}" for s in states)
            raise NetworkError(f"no network controller has a link of robot {robot!r}: {have}")
        # The only controller knows the ego by itself, and who stands in for it.
        return {"": request}

    def unshaped(self, now_s: float) -> tuple[str, ...]:
        """Why links are not shaped that should be, each with its controller's name."""
        return tuple(
            f"{of(name)}{why}"
            for name, state in self.present(now_s).items()
            for why in state.unshaped
        )
