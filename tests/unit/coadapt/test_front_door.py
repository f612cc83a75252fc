"""`import coadapt`: scans, descriptions, bytes, fusion and pictures in a script's hands."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

import coadapt
from swarm.errors import PayloadError, PerceptionError, PictureError, ScanError, WorldError
from tests.support.first_hour import Figure
from tests.support.notebooks import code_lines, code_of, execute
from tests.support.paths import REPOSITORY
from tests.support.recording_files import write_recording
from worlds.base import World, body_of
from worlds.cooperative.fusing import fuse_frame

NOTEBOOK = REPOSITORY / "docs" / "first-hour.ipynb"


@pytest.fixture(scope="module")
def floor() -> World:
    return coadapt.world("factory", robots=3, rings=16)


@pytest.fixture(scope="module")
def clouds(floor: World) -> list[coadapt.Cloud]:
    return [coadapt.scan(floor.scan(robot, 20)) for robot in floor.robots]


@pytest.mark.stumble("a script needs seven deep imports", command="import coadapt")
def test_one_import_has_all_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, coadapt\n"
        "heavy = ('torch', 'zenoh', 'open3d', 'numpy', 'matplotlib', 'options', 'worlds')\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "all(getattr(coadapt, name) for name in coadapt.__all__)\n"
        "print([n for n in ('torch', 'zenoh', 'open3d', 'matplotlib') if n in sys.modules])\n"
        "coadapt.describe(coadapt.world('factory', robots=2).scan('R1', 0))\n"
        "print([n for n in ('torch', 'zenoh', 'open3d') if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    assert done.stdout.split("\n")[:3] == ["[]"] * 3
    assert dir(coadapt) == sorted(coadapt.__all__)
    with pytest.raises(AttributeError, match="no attribute 'scann'"):
        coadapt.scann  # type: ignore[attr-defined]  # noqa: B018


def test_the_types_of_what_is_offered_travel_with_the_packages() -> None:
    for package in ("coadapt", "perception", "swarm", "worlds"):
        assert (REPOSITORY / package / "py.typed").is_file()


def test_a_scan_comes_from_a_file_an_array_a_list_or_a_world(floor: World, tmp_path: Path) -> None:
    rows = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    np.save(tmp_path / "a.npy", np.array(rows))
    for source in (rows, np.array(rows), tmp_path / "a.npy", str(tmp_path / "a.npy")):
        cloud = coadapt.scan(source)
        assert cloud.points.tolist() == rows
        assert cloud.points.dtype == np.float32
        assert cloud.pose is None
    assert np.asarray(coadapt.scan(rows)).shape == (2, 3)
    assert np.asarray(coadapt.scan(rows), dtype=np.float64).dtype == np.float64
    shot = floor.scan("R2", 3)
    taken = coadapt.scan(shot)
    assert taken.points is shot.points
    np.testing.assert_array_equal(taken.pose, shot.pose.matrix())
    with pytest.raises(WorldError, match=r"nothing\.pcd"):
        coadapt.scan(tmp_path / "nothing.pcd")
    with pytest.raises(ScanError, match="shape"):
        coadapt.scan([[1, 2], [3, 4]])


@pytest.mark.stumble(
    "poses and matrices are not alike", command="coadapt.scan(points, pose=matrix)"
)
def test_poses_numbers_and_matrices_say_the_same() -> None:
    pose = coadapt.Pose(1.0, 2.0, 3.0, roll=0.1, pitch=0.2, yaw=2.0)
    rows = [[1.0, 2.0, 3.0]]
    expected = coadapt.scan(rows, pose).pose
    assert expected is not None
    same: tuple[ArrayLike, ...] = (pose.as_tuple(), [*pose.as_tuple()], expected, expected.tolist())
    for told in same:
        found = coadapt.scan(rows, told).pose
        assert found is not None
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ((1, 2, 3), r"shape \(3,\).*\(x, y, z, roll, pitch, yaw\)"),
        (np.diag([1.0, -1.0, 1.0, 1.0]), "mirrors"),
        (2 * np.eye(4), "scales"),
        (np.full((4, 4), np.nan), "not finite"),
        (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 9, 1.0]]), "last row"),
        ("here", "must be numbers"),
    ],
    ids=["three numbers", "mirror", "scale", "nan", "last row", "text"],
)
def test_what_is_no_pose_is_named(pose: object, words: str) -> None:
    with pytest.raises(ScanError, match=words):
        coadapt.scan([[1, 2, 3]], pose)  # type: ignore[arg-type]


def test_points_and_boxes_come_back_from_bytes(clouds: list[coadapt.Cloud]) -> None:
    payload = coadapt.encode(clouds[0], max_error_m=0.05)
    back = coadapt.decode(payload)
    assert isinstance(back, coadapt.Cloud)
    assert len(back) == len(clouds[0])
    boxes = coadapt.fuse(clouds[:1]).boxes
    again = coadapt.decode(coadapt.encode(boxes))
    assert isinstance(again, coadapt.Boxes)
    np.testing.assert_allclose(again.centers, boxes.centers, atol=0.003)
    with pytest.raises(PayloadError):
        coadapt.decode(payload[:-1])


@pytest.mark.parametrize("algorithm", ["early", "late", "intermediate-sparse"])
def test_scripts_fuse_as_a_swarm_does_in_the_egos_frame(
    floor: World, clouds: list[coadapt.Cloud], algorithm: str
) -> None:
    fused = coadapt.fuse(clouds, algorithm=algorithm)
    expected = fuse_frame(floor, 20, "R1", floor.robots, algorithm)
    ego = floor.pose("R1", 20)
    there = fused.boxes.transformed(ego.matrix())
    assert len(fused) == len(expected.boxes) > 0
    np.testing.assert_allclose(there.centers, expected.boxes.centers, atol=0.02)
    assert fused.bytes == expected.bytes
    assert fused.detector == "factory"
    body = body_of(floor, "R2")
    told = fused.known.transformed(ego.matrix()).centers[0]
    place = floor.pose("R2", 20).matrix() @ [*body.center, 1.0]
    np.testing.assert_allclose(told, place[:3], atol=0.3)


def test_pairs_of_points_and_pose_are_parts_too(clouds: list[coadapt.Cloud]) -> None:
    expected = coadapt.fuse(clouds[:2], algorithm="late")
    ego, other = clouds[:2]
    assert ego.pose is not None
    assert other.pose is not None
    fused = coadapt.fuse(
        [(ego.points, ego.pose), (other.points.tolist(), other.pose.tolist())], algorithm="late"
    )
    assert list(fused.bytes) == ["scan 2"]
    np.testing.assert_array_equal(fused.boxes.centers, expected.boxes.centers)
    same = coadapt.fuse([ego, ego], algorithm="late")
    assert list(same.bytes) == ["R1 (2)"]


def test_what_cannot_be_fused_is_named(clouds: list[coadapt.Cloud]) -> None:
    blind = coadapt.scan(clouds[1].points)
    with pytest.raises(ScanError, match=r"scan 2 has no pose.*coadapt\.scan\(file, pose\)"):
        coadapt.fuse([clouds[0], blind])
    with pytest.raises(ScanError, match="nothing to fuse"):
        coadapt.fuse([])
    with pytest.raises(ScanError, match=r"a part to fuse is a ndarray; allowed"):
        coadapt.fuse([clouds[0].points])  # type: ignore[list-item]
    with pytest.raises(PerceptionError, match="'magic' is not"):
        coadapt.fuse(clouds, algorithm="magic")
    with pytest.raises(PerceptionError, match="'moon'"):
        coadapt.fuse(clouds, detector="moon")


def test_the_detector_is_the_one_that_suits_or_has_doubts(clouds: list[coadapt.Cloud]) -> None:
    fits = coadapt.fuse(clouds[:1])
    assert (fits.detector, fits.doubts) == ("factory", ())
    road = coadapt.world("road", robots=2).scan("R1", 0)
    assert coadapt.fuse([road]).detector == "road"
    forced = coadapt.fuse([road], detector="factory")
    assert forced.detector == "factory"
    assert "detector factory, which may not suit: the sensors stand 1.9 m" in repr(forced)


@pytest.mark.stumble("what a script shows fills the screen", command="coadapt.fuse(scans)")
def test_what_scripts_show_is_short(floor: World, clouds: list[coadapt.Cloud]) -> None:
    fused = coadapt.fuse(clouds[:2], algorithm="late")
    shown = {
        "Cloud(R1: 1": repr(clouds[0]),
        "FactoryWorld(R1, R2, R3; 6000 frames at 10 Hz, ": repr(floor),
        "Scan(R1 in frame 20: 1": repr(floor.scan("R1", 20)),
        "Scene(": repr(coadapt.describe(clouds[0])),
        "SceneObject(at ": repr(coadapt.describe(clouds[0]).objects[0]),
        f"Boxes({len(fused)}: ": repr(fused.boxes),
        "Fused(Boxes(": repr(fused),
        "Drawing(2 scans, 50 x 50 m; ": repr(coadapt.draw(fused)),
    }
    for begin, text in shown.items():
        assert text.startswith(begin)
        assert len(text) < 200
        assert "array" not in text
    assert repr(coadapt.Boxes.empty()) == "Boxes(0)"


@pytest.mark.stumble("boxes above a score take a mask", command="fused.above(0.5)")
def test_above_keeps_the_boxes_of_at_least_a_score(clouds: list[coadapt.Cloud]) -> None:
    fused = coadapt.fuse(clouds)
    middle = float(np.median(fused.boxes.scores))
    kept = fused.above(middle)
    assert 0 < len(kept) < len(fused)
    assert kept.scores.min() == middle
    assert len(fused.boxes.above(0.0)) == len(fused)


def test_pictures_are_written_or_shown(clouds: list[coadapt.Cloud], tmp_path: Path) -> None:
    fused = coadapt.fuse(clouds[:2], algorithm="late")
    for name, head in (("a.png", b"\x89PNG"), ("a.pdf", b"%PDF"), ("a.svg", b"<svg")):
        drawing = coadapt.draw(fused, tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(head)
    assert drawing._repr_svg_() == (tmp_path / "a.svg").read_text()
    assert "1 known robot<" in drawing.svg()
    for what in (clouds[0], clouds[0].points, fused.boxes):
        assert coadapt.draw(what).svg().count("<path") >= 2
    with pytest.raises(PictureError, match="there is no directory"):
        coadapt.draw(fused, tmp_path / "no" / "a.png")
    assert not (tmp_path / "no").exists()


def test_a_recording_is_a_world(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run.mcap", (40, 42), robots=2)
    world = coadapt.world(path)
    fused = coadapt.fuse([world.scan(robot, 0) for robot in world.robots], algorithm="late")
    assert list(fused.bytes) == ["R2"]
    with pytest.raises(WorldError, match="world 'moon' is not known; allowed: "):
        coadapt.world("moon")


@pytest.mark.stumble(
    "no notebook tells a script's way", command="jupyter lab docs/first-hour.ipynb"
)
def test_the_notebook_runs_and_shows_what_it_keeps(figure: Figure) -> None:
    notebook = json.loads(NOTEBOOK.read_text())
    kept = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    execute(notebook)
    shown = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    # Another machine's numerics change digits, not words.
    assert [outline(outputs) for outputs in shown] == [outline(outputs) for outputs in kept]
    code = "\n".join(code_of(cell) for cell in notebook["cells"] if cell["cell_type"] == "code")
    steps = re.findall(r"coadapt\.(\w+)\(", code)
    assert [steps.index(name) for name in ("scan", "describe", "encode", "fuse", "draw")] == sorted(
        steps.index(name) for name in ("scan", "describe", "encode", "fuse", "draw")
    )
    assert re.findall(r"^(?:import|from) .*", code, re.MULTILINE) == ["import coadapt"]
    assert NOTEBOOK.stat().st_size < 100_000
    figure("notebook_lines", code_lines(notebook))
    assert code_lines(notebook) <= 15


def outline(outputs: list[dict[str, dict[str, list[str]]]]) -> list[tuple[str, ...]]:
    """The kinds of what is shown, and its text without numbers and what they count."""
    return [
        (*sorted(one["data"]), re.match(r"\W*\w*", one["data"]["text/plain"][0])[0])  # type: ignore[index]
        for one in outputs
    ]
