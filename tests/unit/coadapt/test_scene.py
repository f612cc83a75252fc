from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main

HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH {count}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {count}
DATA ascii
"""


def write_pcd(path: Path, points: list[tuple[float, float, float]]) -> Path:
    lines = [f"{x} {y} {z}\n" for x, y, z in points]
    path.write_text(HEADER.format(count=len(points)) + "".join(lines))
    return path


@pytest.fixture
def pcd(tmp_path: Path) -> Path:
    """A floor 1.5 m below the sensor and a box of 1 x 2 x 1 m on it, 10 m to the right."""
    axis = np.arange(-15, 15, 0.5)
    floor = [(float(x), float(y), -1.5) for x in axis for y in axis]
    sides = np.arange(-0.5, 0.51, 0.1), np.arange(-11.0, -8.99, 0.1), np.arange(-1.0, -0.49, 0.1)
    box = [(float(x), float(y), float(z)) for x in sides[0] for y in sides[1] for z in sides[2]]
    return write_pcd(tmp_path / "scan.pcd", floor + box)


@pytest.mark.parametrize("method", ["fast", "reference"])
def test_json_describes_the_objects_in_the_frame_of_the_file(
    pcd: Path, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scene", str(pcd), "--method", method, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {"objects", "ground_points", "elapsed_ms"}
    assert report["ground_points"] == 3600
    assert report["elapsed_ms"] > 0
    (found,) = report["objects"]
    assert set(found) == {"centroid", "distance", "size", "points", "density"}
    assert found["centroid"] == pytest.approx([0, -10, -0.75], abs=1e-3)
    assert found["distance"] == pytest.approx(np.hypot(10, 0.75), abs=1e-3)
    assert found["size"] == pytest.approx([1, 2, 0.5], abs=1e-3)
    assert found["points"] == 11 * 21 * 6
    assert found["density"] == pytest.approx(11 * 21 * 6, rel=1e-3)


def test_without_json_the_nearest_object_comes_first(
    pcd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scene", str(pcd)]) == 0
    heading, first, summary = capsys.readouterr().out.splitlines()
    assert heading.split()[0] == "distance"
    assert first.split()[0] == "10.03"
    assert summary.startswith("1 objects, 3600 ground points of 4986")


def test_an_empty_scan_is_an_empty_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scene", str(write_pcd(tmp_path / "empty.pcd", [])), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["objects"], report["ground_points"]) == ([], 0)


def test_a_file_that_cannot_be_read_ends_with_its_name_and_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "none.pcd"
    assert main(["scene", str(missing), "--json"]) == 1
    answer = capsys.readouterr()
    assert answer.out == ""
    assert str(missing) in answer.err


def test_an_unknown_method_is_wrong_usage(pcd: Path) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["scene", str(pcd), "--method", "slow"])
    assert exit_.value.code == 2
