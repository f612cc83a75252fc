"""One pass of the ego's detector over everything that robots send, whatever each one sends.

Points join the own cloud; the encoder makes the map of it; maps of other robots are fused into that
map; the decoder finds boxes; boxes of other robots are merged into those. What nobody sends costs
nothing: with robots of one kind only this is early, intermediate or late fusion alone.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from perception.boxes import weighted_fusion
from perception.codec.outlined import take_outline
from perception.detector.finders import Finder, Learned
from perception.fusion.aligner import Aligner, in_world
from perception.fusion.base import Contribution, FrameRequest, Fusion, Gathering
from perception.fusion.known import without_own
from perception.types import Boxes, clean_points
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, Points, Pose, invert, pose_of, transform

if TYPE_CHECKING:
    from torch import Tensor

    from perception.detector.learned import Detector
    from perception.fusion.maps import SentMap


class Form(Fusion):
    """A fusion whose robots send points, feature maps or boxes: one of the kinds below."""

    finder: Finder
    """Finds the boxes in the ego's cloud."""
    tells_pose = True
    """Whether robots must know where the ego is."""
    asks = False
    """Whether the ego tells robots what it wants to know: see `demand`."""

    def demand(self, own: Tensor) -> bytes:
        """What the ego asks for, from its own map; empty: everything."""
        return b""

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts a frame to which everybody sends this form."""
        return OnePass({self.name: self}, own, world_from_own)


class PointForm(Form):
    """Robots send points."""

    @abstractmethod
    def read(self, payload: bytes) -> Points:
        """The points of a payload without its outline, in the sender's frame. Raises
        PayloadError."""


class MapForm(Form):
    """Robots send cells of a feature map in the ego's frame."""

    @abstractmethod
    def read(self, payload: bytes, reference: Pose) -> SentMap:
        """The map of a payload without its outline, made for the ego at `reference`. Raises
        PayloadError."""

    @abstractmethod
    def join(self, own: Tensor, sent: Sequence[SentMap]) -> Tensor:
        """The ego's map (C, rows, columns) with others in its frame."""


class BoxForm(Form):
    """Robots send boxes."""

    tells_pose = False

    @abstractmethod
    def read(self, payload: bytes) -> Boxes:
        """The boxes of a payload without its outline, in the sender's frame. Raises
        PayloadError."""


class OnePass(Gathering):
    """One frame of any forms."""

    def __init__(self, forms: Mapping[str, Form], own: Points, world_from_own: Matrix) -> None:
        """`forms` that robots may send, by name, at least one. A contribution that names none has
        the first one."""
        self._forms = forms
        self._first = first = next(iter(forms.values()))
        self._finder = first.finder
        self._points = own
        self._world_from_own = world_from_own
        self._own_from_world = invert(world_from_own)
        self._reference = pose_of(world_from_own)
        self._aligner = Aligner(own) if first.corrects else None
        self._boxes_only = all(isinstance(form, BoxForm) for form in forms.values())
        self._map: Tensor | None = None
        self._boxes: Boxes | None = None
        self._robots: list[str] = []
        self._senders: list[Matrix] = []
        """Of each robot: its sensor in the ego's frame, as it was told."""
        # What was sent, by number of the robot.
        self._clouds: dict[int, Points] = {}
        self._maps: dict[MapForm, dict[int, SentMap]] = {}
        self._sent: dict[int, Boxes] = {}
        self._left_out: dict[str, str] = {}

    def ask(self) -> FrameRequest:
        """See `Gathering.ask`."""
        return self.ask_for(self._first.name)

    def ask_for(self, form: str) -> FrameRequest:
        """See `Gathering.ask_for`. Raises KeyError for a form that is none of the frame's."""
        wanted = self._forms[form]
        reference = self._reference if wanted.tells_pose else None
        return FrameRequest(reference, wanted.demand(self._own_map()) if wanted.asks else b"")

    def prepare(self) -> None:
        """See `Gathering.prepare`."""
        if self._aligner is not None:
            self._aligner.prepare()
        if self._boxes_only:
            self._own_boxes()
        elif not any(isinstance(form, PointForm) for form in self._forms.values()):
            # Where points may come, the map would have to be made again.
            self._own_map()

    def add(self, contribution: Contribution) -> None:
        """See `Gathering.add`."""
        form = self._forms[contribution.form] if contribution.form else self._first
        payload, places = take_outline(contribution.payload)
        number = len(self._robots)
        sender = self._own_from_world @ contribution.world_from_sensor
        match form:
            case PointForm():
                points = form.read(payload)
                self._align(places, sender, contribution.robot)
                self._clouds[number] = points
            case MapForm():
                one = form.read(payload, self._reference)
                self._align(places, sender, contribution.robot)
                self._maps.setdefault(form, {})[number] = one
            case BoxForm():
                boxes = form.read(payload)
                self._align(places, sender, contribution.robot)
                self._sent[number] = boxes
        self._robots.append(contribution.robot)
        self._senders.append(sender)

    def finish(self) -> Boxes:
        """See `Gathering.finish`."""
        senders, by = self._corrected()
        self._leave_out()
        found = self._decoded(senders, by)
        if self._sent or self._boxes_only:
            others = [boxes.transformed(senders[number]) for number, boxes in self._sent.items()]
            found = weighted_fusion(Boxes.concatenate([found, *others]))
        found = without_own(found, self._finder.config.own_body_m, self.stood_at)
        return found.transformed(self._world_from_own)

    def corrections(self) -> dict[str, Matrix]:
        """See `Gathering.corrections`."""
        return in_world(self._aligner, self._robots, self._world_from_own)

    def left_out(self) -> dict[str, str]:
        """See `Gathering.left_out`."""
        return dict(self._left_out)

    def sent_points(self) -> dict[str, tuple[Points, Matrix]]:
        """See `Gathering.sent_points`."""
        senders, _ = self._corrected()
        return {
            self._robots[number]: (points, self._world_from_own @ senders[number])
            for number, points in self._clouds.items()
        }

    def _corrected(self) -> tuple[list[Matrix], list[Matrix]]:
        """Senders in the ego's frame, and by what they are corrected there."""
        by = [np.eye(4) for _ in self._senders]
        if self._aligner is not None:
            by = self._aligner.corrections(self.remembered)
        return [turn @ sender for turn, sender in zip(by, self._senders, strict=True)], by

    def _leave_out(self) -> None:
        """Drops what was sent from who knows where: beside what others show of the same, it is
        something else."""
        if self._aligner is None:
            return
        for number, why in self._aligner.unplaced().items():
            self._left_out[self._robots[number]] = why
            self._clouds.pop(number, None)
            self._sent.pop(number, None)
            for form, maps in list(self._maps.items()):
                maps.pop(number, None)
                if not maps:
                    del self._maps[form]

    def _align(self, places: NDArray[np.float64], sender: Matrix, robot: str) -> None:
        if self._aligner is not None:
            self._aligner.add(places, sender, robot)

    def _decoded(self, senders: list[Matrix], by: list[Matrix]) -> Boxes:
        """The boxes of all points and maps, in the ego's frame. `senders` in it, and by what they
        and their maps are corrected."""
        if not self._clouds and not self._maps:
            return self._own_boxes()
        cloud = clean_points(self._points)
        if self._clouds:
            others = [
                clean_points(transform(senders[number], points))
                for number, points in self._clouds.items()
            ]
            cloud = np.concatenate([cloud, *others])
        if not self._maps:
            return self._finder.find(cloud, [senders[number] for number in self._clouds])
        detector = self._detector()
        fused = detector.encode(cloud) if self._clouds else self._own_map()
        for form, maps in self._maps.items():
            config = detector.config
            half = (config.half_x_m, config.half_y_m)
            fused = form.join(fused, [one.moved(half, by[i]) for i, one in maps.items()])
        return detector.decode(fused)

    def _detector(self) -> Detector:
        if not isinstance(self._finder, Learned):
            raise PerceptionError(f"there are no weights for {self._finder.config.name!r}")
        return self._finder.detector

    def _own_map(self) -> Tensor:
        if self._map is None:
            self._map = self._detector().encode(clean_points(self._points))
        return self._map

    def _own_boxes(self) -> Boxes:
        if self._boxes is None:
            if self._map is None:
                self._boxes = self._finder.find(clean_points(self._points))
            else:
                self._boxes = self._detector().decode(self._map)
        return self._boxes
