"""The figures of a comparison, as SVG; the same rows give the same files."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.policies.as_published import by_policy
from research.evaluation.policies.controls import is_control
from research.evaluation.policies.results import ORACLE, STATIC, Means, Row
from research.evaluation.published import Summary
from research.evaluation.windows.contents import Contents
from swarm.errors import EvaluationError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Places = Mapping[tuple[str, int], Mapping[str, tuple[float, float]]]
"""By scenario and window, where each robot is: x and y from the ego, metres, world axes."""
BANDS_BPS = (0.0, 2e6, 12.5e6, 37.5e6, np.inf)
"""Half-way between the paper's tiers; below the first of them what telemetry leaves."""
BAND_NAMES = ("below 2", "2 to 12.5", "12.5 to 37.5", "37.5 and more")
MARKERS = "osD^vP*Xp<>hd8"


def need_drawing() -> None:
    """Raises EvaluationError where the drawing library is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise EvaluationError(
            "figures need matplotlib: pip install 'coadapt-edge[figures]', or make setup"
        )


def draw_figures(
    folder: Path,
    rows: Sequence[Row],
    means: Sequence[Means],
    places: Places,
    held: Contents,
    published: Sequence[Summary] = (),
) -> list[str]:
    """Writes all figures into the folder and returns their names.

    Controls are left out. Raises EvaluationError where the drawing library is not installed.
    """
    need_drawing()
    rows = [row for row in rows if not is_control(row.decided.policy)]
    means = [one for one in means if not is_control(one.policy)]
    import matplotlib
    from matplotlib.figure import Figure

    adaptive = [one.policy for one in means if not one.policy.startswith((STATIC, "random"))]
    drawings: dict[str, tuple[tuple[float, float], Callable[[Figure], None]]] = {
        "participants": ((7, 4), lambda figure: _participants(figure, rows, adaptive)),
        "positions": ((9, 4.5), lambda figure: _positions(figure, rows, adaptive, places)),
        "strategy": ((9, 3.5), lambda figure: _strategy(figure, rows, adaptive)),
        "bytes-precision": (
            (9, 5),
            lambda figure: _bytes_precision(figure, rows, means, held, published),
        ),
        "by-strategy": ((8, 3.5), lambda figure: _by_strategy(figure, rows)),
        "regret": ((7, 3.5), lambda figure: _regret(figure, rows, means)),
    }
    with matplotlib.rc_context({"svg.hashsalt": "coadapt", "font.size": 9}):
        for name, (size, draw) in drawings.items():
            figure = Figure(size, layout="constrained")
            draw(figure)
            figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    return [f"{name}.svg" for name in drawings]


def _of(rows: Sequence[Row], policy: str) -> list[Row]:
    return [row for row in rows if row.decided.policy == policy]


def _band(row: Row) -> int:
    return int(np.searchsorted(BANDS_BPS, row.capacity_bps, side="right")) - 1


def _participants(figure: Figure, rows: Sequence[Row], policies: Sequence[str]) -> None:
    """Share of those in range that take part, by bandwidth."""
    axes: Axes = figure.subplots()
    wide = 0.8 / max(1, len(policies))
    for index, policy in enumerate(policies):
        own = [row for row in _of(rows, policy) if row.decided.in_range]
        for band in range(len(BAND_NAMES)):
            shares = [
                len(row.decided.choice.participants) / len(row.decided.in_range)
                for row in own
                if _band(row) == band
            ]
            if shares:
                mean = bootstrap_mean(shares)
                axes.bar(
                    band + (index - (len(policies) - 1) / 2) * wide,
                    mean.mean,
                    wide * 0.9,
                    yerr=[[mean.mean - mean.low], [mean.high - mean.mean]],
                    color=f"C{index}",
                    label=policy if policy not in axes.get_legend_handles_labels()[1] else None,
                    error_kw={"linewidth": 0.8},
                )
    axes.set_xticks(range(len(BAND_NAMES)), BAND_NAMES)
    axes.set_xlabel("C(t), Mbit/s")
    axes.set_ylabel("share of robots in range that take part")
    figure.legend(loc="outside right upper", fontsize=8)


def _positions(
    figure: Figure, rows: Sequence[Row], policies: Sequence[str], places: Places
) -> None:
    """Where chosen and excluded robots are, seen from the ego."""
    shown = [policy for policy in policies if policy != ORACLE] or list(policies)
    for axes, policy in zip(
        np.atleast_1d(figure.subplots(1, len(shown), sharex=True, sharey=True)), shown, strict=True
    ):
        for chosen, color, size, label in (
            (False, "#bbbbbb", 12, "left out"),
            (True, "#d1495b", 14, "chosen"),
        ):
            points = [
                places[row.decided.scenario, row.decided.window][robot]
                for row in _of(rows, policy)
                for robot in row.decided.in_range
                if (robot in row.decided.choice.participants) is chosen
            ]
            if points:
                axes.scatter(*zip(*points, strict=True), s=size, c=color, label=label, alpha=0.7)
        axes.plot(0, 0, "^", color="black", markersize=7)
        axes.set_aspect("equal")
        axes.set_title(policy)
        axes.set_xlabel("m east of the ego")
        axes.legend(fontsize=7)
    figure.supylabel("m north of the ego")


def _strategy(figure: Figure, rows: Sequence[Row], policies: Sequence[str]) -> None:
    """How often each algorithm is chosen, by bandwidth."""
    algorithms = sorted({row.decided.choice.algorithm for row in rows})
    for axes, policy in zip(
        np.atleast_1d(figure.subplots(1, len(policies), sharey=True)), policies, strict=True
    ):
        own = _of(rows, policy)
        bands = [[row for row in own if _band(row) == band] for band in range(len(BAND_NAMES))]
        floor = np.zeros(len(bands))
        for index, algorithm in enumerate(algorithms):
            share = np.array([_share(band, algorithm) for band in bands])
            axes.bar(
                range(len(bands)), share, bottom=floor, color=f"C{index}",
                label=algorithm or "the ego alone",
            )  # fmt: skip
            floor += share
        axes.set_xticks(range(len(BAND_NAMES)), BAND_NAMES, rotation=60)
        axes.set_title(policy)
    figure.supxlabel("C(t), Mbit/s")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8)


def _share(rows: Sequence[Row], algorithm: str) -> float:
    if not rows:
        return 0.0
    return float(np.mean([row.decided.choice.algorithm == algorithm for row in rows]))


def _bytes_precision(
    figure: Figure,
    rows: Sequence[Row],
    means: Sequence[Means],
    held: Contents,
    published: Sequence[Summary],
) -> None:
    """Every policy's precision against its bytes, and what of it comes in time.

    The factory and OPV2V have axes of their own: they are other scenes, with other classes.
    """
    recorded = any(row.scenario.folder is not None for row in rows)
    names = ["OPV2V"] if recorded else ["simulated factory", *(["OPV2V"] if published else [])]
    shown: dict[str, Axes] = dict(
        zip(names, figure.subplots(1, len(names), squeeze=False)[0], strict=True)
    )
    _ours(shown[names[0]], rows, means, held)
    if published:
        _theirs(shown["OPV2V"], published)
    for name, axes in shown.items():
        axes.set_xscale("log")
        axes.set_xlabel("bytes a fused frame")
        axes.set_ylabel("AP@0.7")
        axes.margins(x=0.3)
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.3)
    title = (
        "filled: what the link delivers; hollow: if all came in time; |: bytes as CoAdapt counts"
    )
    figure.suptitle(f"{title}\nblack: CoAdapt as published" if published else title, fontsize=8)
    figure.legend(loc="outside right upper", fontsize=8)


def _ours(axes: Axes, rows: Sequence[Row], means: Sequence[Means], held: Contents) -> None:
    counted = {one.of: one.published_bytes_per_frame for one in by_policy(rows, held)}
    for index, one in enumerate(means):
        marker, color = MARKERS[index % len(MARKERS)], f"C{index % 10}"
        size = max(one.bytes_per_frame, 100.0)
        axes.plot([size, size], [one.ap_70, one.delivered_ap_70], color=color, linewidth=1)
        axes.plot(
            size, one.ap_70, marker, color=color, markersize=8, markerfacecolor="white",
            linestyle="none",
        )  # fmt: skip
        axes.plot(
            size, one.delivered_ap_70, marker, color=color, markersize=8, label=one.policy,
            linestyle="none",
        )  # fmt: skip
        axes.plot(max(counted[one.policy], 100.0), one.ap_70, "|", color=color, markersize=9)


def _theirs(axes: Axes, published: Sequence[Summary]) -> None:
    for summary in published:
        for size, ap_70, label in _published_points(summary):
            axes.plot(size, ap_70, "+" if "everyone" in label else "x", color="black", markersize=8)
            axes.annotate(label, (size, ap_70), xytext=(5, 3), textcoords="offset points", size=7)


def _published_points(one: Summary) -> Iterator[tuple[float, float, str]]:
    yield one.bytes_per_frame, one.ap_70, one.name
    if one.fewer:
        yield one.everyone_bytes_per_frame, one.everyone_ap_70, f"{one.name}, everyone"


def _by_strategy(figure: Figure, rows: Sequence[Row]) -> None:
    """Bytes and precision by algorithm, over all policies' choices, each once a window."""
    once = {
        (row.decided.scenario, row.decided.window, row.decided.choice): row
        for row in rows
        if row.decided.choice.algorithm
    }
    algorithms = sorted({choice.algorithm for _, _, choice in once})
    left, right = figure.subplots(1, 2)
    groups = [[row for key, row in once.items() if key[2].algorithm == a] for a in algorithms]
    left.boxplot([[r.outcome.bytes_per_frame for r in group] for group in groups])
    left.set_yscale("log")
    left.set_ylabel("bytes a fused frame")
    right.boxplot([[r.outcome.ap_70 for r in group] for group in groups])
    right.set_ylabel("AP@0.7 of a window")
    for axes in (left, right):
        axes.set_xticks(range(1, len(algorithms) + 1), algorithms, rotation=30, ha="right")


def _regret(figure: Figure, rows: Sequence[Row], means: Sequence[Means]) -> None:
    """Mean regret with its interval."""
    axes: Axes = figure.subplots()
    names = [one.policy for one in means if one.policy != ORACLE]
    for place, name in enumerate(reversed(names)):
        own = _of(rows, name)
        mean = bootstrap_mean([row.regret for row in own], [row.scenario.group for row in own])
        spread = [[mean.mean - mean.low], [mean.high - mean.mean]]
        axes.errorbar(mean.mean, place, xerr=spread, fmt="o", color="C0", capsize=3)
    axes.set_yticks(range(len(names)), list(reversed(names)))
    axes.set_xlabel("mean regret against the oracle, AP@0.7 - lambda C (95 % interval)")
    axes.grid(axis="x", alpha=0.3)
