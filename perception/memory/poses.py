"""By what senders' poses are off, remembered from frame to frame.

For each sender a Kalman filter in information form follows the shift along the world's x and y and
the turn about the sender that put what it sees in its place; these wander (a random walk). What a
frame shows of them (`perception.fusion.alignment.Estimate`) holds what poses usually err by, which
is taken out again before it is joined with what is known.

Whether an error lasts is learnt for each sender: a frame shows either the error that is known or
one that is drawn anew, and how often it is anew is counted (Adams and MacKay, "Bayesian online
changepoint detection", 2007, with the likelier of the two kept). So a pose that was set anew is
estimated anew at once, and poses that err anew in each frame are believed frame by frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from perception.fusion.aligner import PLACED_M, Known, usual
from perception.fusion.alignment import (
    MIN_GAIN,
    PRIOR_SHIFT_M,
    PRIOR_TURN_RAD,
    Estimate,
    correction,
    small,
)
from perception.fusion.known import KnownRobot, seen_at
from perception.jumps import Whereabouts
from swarm.geometry import Matrix, yaw_of

Floats = NDArray[np.float64]

MOST_SENDERS = 64
FORGOTTEN_S = 30.0
"""Of a sender of which nothing was shown for so long nothing is known."""
UNIT = np.array([PRIOR_SHIFT_M, PRIOR_SHIFT_M, PRIOR_TURN_RAD])
"""Moves (x, y, turn) are kept in these, what poses usually err by: the usual covariance is 1."""
OUTLINE = np.square(np.array([0.005, 0.005, math.radians(0.01)]) / UNIT)
"""Variances of what a frame shows beyond those that it tells: an outline's own error."""
WANDERS = np.square(np.array([0.1, 0.1, math.radians(0.1)]) / UNIT)
"""Variances of what an error changes by in a second."""
ANEW, COUNTED = 0.2, 3.0
"""How likely an error is anew in a frame before that was counted, and for as many frames this
counts."""
COUNTS_FOR = 10.0
"""Frames that are counted; those before fade."""
DOUBT = 0.15
"""From this chance on that an error is anew, the frame speaks for itself. This and what is above
were set on floors of the seeds from 1,780,000 on."""
SURE = 4.0
"""By how much the log likelihood of an error must exceed that of none."""
SELDOM, AGAIN = 0.15, 3
"""An error lasts that is anew in a smaller part of the frames, and was shown so often since it was
anew."""
KNOWN = np.square(np.array([0.1, 0.1, math.radians(0.2)]) / UNIT)
"""Variances of what is known well enough to do without an outline: after a second without one, no
error is. Tried on floors of the seeds from 1,946,000 on."""


@dataclass(slots=True)
class _Sender:
    """What is known of one sender."""

    time_s: float
    """When it was heard last."""
    shown_s: float
    """When anything was shown of its error last."""
    move: Floats
    """(3,): x and y in the world's axes and turn, in UNIT."""
    covariance: Floats
    """(3, 3), of the same."""
    anew: float = ANEW * COUNTED
    frames: float = COUNTED
    """How often its error was anew, of so many frames."""
    lasted: int = 0
    """How often the same error was shown again."""
    where: Whereabouts = field(default_factory=Whereabouts)
    """Where it believes to stand, as it contributes."""
    told_where: Whereabouts = field(default_factory=Whereabouts)
    """The same, as its beacons tell."""
    told: Floats = field(default_factory=lambda: np.zeros(3))
    """The move (3,) in metres and radians by all that was shown; zeros where it is as likely that
    there is none. What shows nothing leaves it as it is."""
    was_m: float | None = None
    """By how much its pose was off when that was shown well last."""

    def wait(self, time_s: float) -> None:
        """Its error wanders."""
        waited_s = max(0.0, time_s - self.time_s)
        self.covariance = self.covariance + np.diag(WANDERS * waited_s)
        self.time_s += waited_s

    def take(self, sure: Floats, weighed: Floats) -> bool:
        """Takes up what a frame shows: its information (3, 3) and that times the move (3,).
        Returns whether the error was known before."""
        inverse = np.linalg.inv(self.covariance)
        known = inverse @ self.move
        lasts = _evidence(
            float(self.move @ known), known + weighed, self.covariance, inverse + sure
        )
        fresh = np.eye(3)
        drawn = _evidence(0.0, weighed, fresh, fresh + sure)
        chance = self.anew / self.frames
        odds = math.log(chance / (1.0 - chance)) + drawn - lasts
        anew = 1.0 / (1.0 + math.exp(min(-odds, 700.0)))
        fades = 1.0 - 1.0 / COUNTS_FOR
        # As with Laplace's rule, neither becomes impossible.
        self.anew = min(max(fades * self.anew + anew, 0.01), fades * self.frames + 0.99)
        self.frames = fades * self.frames + 1.0
        if anew > DOUBT:
            inverse, known = fresh, np.zeros(3)
        self.lasted = 0 if anew > DOUBT else self.lasted + 1
        self.covariance = np.asarray(np.linalg.inv(inverse + sure), dtype=np.float64)
        self.move = self.covariance @ (known + weighed)
        gain = 0.5 * self.move @ np.linalg.solve(self.covariance, self.move)
        move = self.move * UNIT
        self.told = np.zeros(3) if gain < SURE or small(move) else move
        if self.left_m() <= PLACED_M:
            self.was_m = math.hypot(*move[:2])
        return anew <= DOUBT

    def left_m(self) -> float:
        """By how much its pose is still off, once `told` has put it right: root of the mean
        square. Nothing, where the error lasts: what was shown of it holds."""
        if self.lasts():
            return 0.0
        known = Estimate(self.move * UNIT, self.covariance * np.outer(UNIT, UNIT), 0.0)
        return known.left_m(self.told)

    def known(self, time_s: float) -> bool:
        """Whether its error lasts, and is known well enough at that time."""
        # The steady clock of captures may have been put back: then it is not known, either.
        variances = np.diag(self.covariance) + WANDERS * abs(time_s - self.time_s)
        return self.lasts() and bool((variances < KNOWN).all())

    def lasts(self) -> bool:
        """Whether its error is the same in most frames, and was of late."""
        return self.lasted >= AGAIN and self.anew < SELDOM * self.frames


class PoseMemory:
    """By what each sender's pose is off. For one thread, but for what any may ask."""

    def __init__(self) -> None:
        self._senders: dict[str, _Sender] = {}
        """The one that was heard last stands last."""
        self._whereabouts = Whereabouts()
        """The ego's."""
        self._followed_s = -math.inf

    def __len__(self) -> int:
        return len(self._senders)

    def at(self, time_s: float, stood_s: float, world_from_own: Matrix) -> PosesAt:
        """See `Remembering.at`. Changes nothing: any thread may ask for it."""
        return PosesAt(self, time_s, stood_s, world_from_own)

    def knows(self, robot: str, time_s: float) -> bool:
        """Whether it is known well enough by what a sender's pose is off at that time to do without
        its outline. Any thread may ask."""
        one = self._senders.get(robot)
        return one is not None and one.known(time_s)

    def put_right(
        self,
        known: Sequence[KnownRobot],
        corrections: Mapping[str, Matrix],
        time_s: float,
        world_from_own: Matrix,
    ) -> tuple[KnownRobot, ...]:
        """Known robots in the world frame where they are: by a frame's corrections, 4 x 4 in the
        world frame, and whom it does not show by its error, where that lasts. `world_from_own`:
        where the ego stands at that time, also where nobody contributes."""
        self.follow(time_s, world_from_own)
        remembered = {}
        for one in known:
            sender = self._senders.get(one.robot)
            if sender is None:
                continue
            if sender.told_where.jumps(time_s, one.here_from_sensor):
                # Whoever was placed anew errs anew, and may be silent long after that.
                del self._senders[one.robot]
                continue
            if sender.lasts() and time_s - sender.shown_s <= FORGOTTEN_S:
                stands = one.here_from_sensor[:2, 3]
                remembered[one.robot] = correction(sender.told, stands)
        return seen_at(known, {**remembered, **corrections})

    def follow(self, time_s: float, world_from_own: Matrix) -> None:
        """Forgets everything where the ego, which stands there at that time, has jumped, or its
        clock was put back by more than FORGOTTEN_S."""
        back_s = self._followed_s - time_s
        if back_s > FORGOTTEN_S:
            self._senders.clear()
            self._whereabouts.forget()
        elif back_s > 0.0:
            return
        if self._whereabouts.jumps(time_s, world_from_own):
            self._senders.clear()
        self._followed_s = time_s

    def take(
        self,
        time_s: float,
        robot: str,
        world_from_sender: Matrix,
        move: Floats,
        covariance: Floats,
    ) -> tuple[Floats, float] | None:
        """What a frame shows of a sender that believes to stand there: the move (3,) that would
        put it right, in the world's axes, and its covariance. Returns the move by all that was
        shown until now, and how far off that leaves it; None where its error was not known
        before."""
        one = self._senders.pop(robot, None)
        if one is not None and (
            time_s - one.shown_s > FORGOTTEN_S or one.where.jumps(time_s, world_from_sender)
        ):
            one = None
        known = one is not None
        if one is None:
            one = _Sender(time_s, time_s, np.zeros(3), np.eye(3))
            one.where.jumps(time_s, world_from_sender)
        sure, weighed = _information(move, covariance)
        if not sure.any() and not known:
            return None
        one.wait(time_s)
        # What shows nothing is no evidence of another error, either.
        lasts = True
        if sure.any():
            lasts, one.shown_s = one.take(sure, weighed), time_s
        self._senders[robot] = one
        if len(self._senders) > MOST_SENDERS:
            del self._senders[next(iter(self._senders))]
        return (one.told, one.left_m()) if known and lasts else None

    def usual_m(self, time_s: float) -> float | None:
        """By how much poses are off, root of the mean square over senders of which it was shown
        well; None where it was of none."""
        return usual(
            [
                one.was_m
                for one in self._senders.values()
                if one.was_m is not None and time_s - one.shown_s <= FORGOTTEN_S
            ]
        )


@dataclass(frozen=True, slots=True)
class PosesAt:
    """The memory of poses for one frame: see `perception.fusion.aligner.Corrections`."""

    memory: PoseMemory
    time_s: float
    stood_s: float
    world_from_own: Matrix

    def corrected(self, robot: str, own_from_sender: Matrix, shown: Estimate) -> Known | None:
        """See `Corrections.corrected`."""
        self.memory.follow(self.stood_s, self.world_from_own)
        if shown.gain < MIN_GAIN and not small(shown.move):
            # Frames look alike: many that show a little each would be taken for a lot.
            shown = Estimate.nothing()
        turn = _turn(yaw_of(self.world_from_own))
        taken = self.memory.take(
            self.time_s,
            robot,
            self.world_from_own @ own_from_sender,
            turn @ shown.move,
            turn @ shown.covariance @ turn.T,
        )
        if taken is None:
            return None
        move, left_m = taken
        return Known(correction(turn.T @ move, own_from_sender[:2, 3]), left_m)

    def usual_m(self) -> float | None:
        """See `Corrections.usual_m`."""
        return self.memory.usual_m(self.time_s)


def _turn(yaw: float) -> Floats:
    """(3, 3): moves in axes that are turned by yaw as moves in the world's."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _information(move: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """What a frame shows without what poses usually err by: information (3, 3) and that times the
    move (3,), in UNIT."""
    variances, axes = np.linalg.eigh(covariance / np.outer(UNIT, UNIT) + np.diag(OUTLINE))
    variances = np.minimum(variances, 1.0)
    along = np.where(variances < 1.0, axes.T @ (move / UNIT) / variances, 0.0)
    return (axes * (1.0 / variances - 1.0)) @ axes.T, axes @ along


def _evidence(before: float, weighed: Floats, covariance: Floats, inverse: Floats) -> float:
    """Log likelihood of what a frame shows, up to a constant, where moves were expected with this
    covariance and are known with this `inverse` of one afterwards."""
    spread = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inverse)[1]
    return float(0.5 * (weighed @ np.linalg.solve(inverse, weighed) - before - spread))
