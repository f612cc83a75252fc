"""Scans of all kinds of files and arrays, and what is said about those that are none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coadapt.main import main
from swarm.errors import CoAdaptError, ScanError
from worlds.scans import is_scan, read_scan

POINTS = np.array([[1.5, -2.25, 3.0], [4.0, 5.5, -6.125], [7, 8, 9]], dtype=np.float32)
OTHERS = "element edge 2\nproperty int vertex1\n"
FOUR = np.column_stack([POINTS, [0.1, 0.2, 0.3]]).astype(np.float32)


def ply(kind: str, properties: str = "float x,float y,float z", before: str = "") -> bytes:
    lines = "".join(f"property {one}\n" for one in properties.split(",") if one)
    return (
        f"ply\nformat {kind} 1.0\ncomment by a test\n{before}element vertex 3\n{lines}"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def pcd(kind: str, fields: str = "x y z") -> bytes:
    many = len(fields.split())
    return (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE{' 4' * many}\nTYPE{' F' * many}\n"
        f"COUNT{' 1' * many}\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA {kind}\n"
    ).encode()


def npy(path: Path, array: Any) -> bytes:
    np.save(path, array)
    return path.read_bytes()


def npy_header(text: str) -> bytes:
    """A file of the format's first version with that header, and no numbers."""
    head = text.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\1\0" + len(head).to_bytes(2, "little") + head


TEXT = "\n".join(" ".join(str(v) for v in row) for row in POINTS).encode()
DOUBLE = "double x,double y,double z,uchar ring"
RECORDS = np.dtype([("x", ">f8"), ("y", ">f8"), ("z", ">f8"), ("ring", "u1")])


def records() -> bytes:
    table = np.zeros(3, dtype=RECORDS)
    for at, name in enumerate("xyz"):
        table[name] = POINTS[:, at]
    return table.tobytes()


@pytest.mark.stumble(
    "scans as .bin, .ply or .npy cannot be read", command="coadapt scene 000000.bin"
)
@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.pcd", pcd("ascii") + TEXT),
        ("a.bin", FOUR.tobytes()),
        ("A.BIN", FOUR.tobytes()),
        ("a.pcd.bin", np.column_stack([FOUR, [0, 1, 2]]).astype("<f4").tobytes()),
        ("a.ply", ply("ascii") + TEXT + b"\n3 0 1 2\n"),
        ("b.ply", ply("binary_little_endian") + POINTS.tobytes() + b"\x03" + bytes(12)),
        ("c.ply", ply("binary_big_endian", DOUBLE) + records()),
        (
            "d.ply",
            ply("binary_little_endian", before="element id 2\nproperty short number\n")
            + bytes(4)
            + POINTS.tobytes(),
        ),
    ],
)
def test_a_file_of_any_kind_gives_its_points(tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    assert is_scan(path)
    for source in (path, str(path)):
        points = read_scan(source)
        assert points.dtype == np.float32
        assert np.array_equal(points, POINTS)


@pytest.mark.parametrize("array", [POINTS, FOUR, FOUR.astype(np.float64), POINTS.astype(">f4")])
def test_an_npy_file_of_three_or_four_columns_gives_its_points(
    tmp_path: Path, array: np.ndarray[Any, Any]
) -> None:
    np.save(tmp_path / "a.npy", array)
    assert np.array_equal(read_scan(tmp_path / "a.npy"), POINTS)


def test_arrays_lists_and_fields_give_their_points() -> None:
    fields = np.zeros(3, dtype=[("ring", "u1"), ("z", "f8"), ("y", "f8"), ("x", "f8")])
    for at, name in enumerate("xyz"):
        fields[name] = POINTS[:, at]
    rows = [tuple(row) for row in FOUR.tolist()]
    sources: list[Any] = [POINTS, FOUR, POINTS.tolist(), rows, fields]
    for source in sources:
        points = read_scan(source)
        assert points.dtype == np.float32
        assert np.array_equal(points, POINTS)
    assert read_scan([]).shape == (0, 3)


def test_rays_without_return_are_no_points() -> None:
    rays: Any = [[np.nan, 0, 1], [1, np.inf, 0], [0, 0, 0], [0, 0, 1], [1e60, 1, 1]]
    assert np.array_equal(read_scan(rays), [[0, 0, 1]])


def test_files_of_the_point_cloud_library_are_read_compressed(tmp_path: Path) -> None:
    o3d = pytest.importorskip("open3d")
    rng = np.random.default_rng(3)
    points = np.round(rng.normal(size=(5000, 3)), 1).astype(np.float32)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    cloud.paint_uniform_color((0.5, 0.1, 0.2))
    path = tmp_path / "compressed.pcd"
    assert o3d.io.write_point_cloud(str(path), cloud, compressed=True)
    assert b"binary_compressed" in path.read_bytes()[:300]
    assert np.array_equal(read_scan(path), points)


@pytest.mark.stumble("a cloud without x is called anything but that", command="coadapt scene a.pcd")
@pytest.mark.parametrize(
    ("name", "data", "fields"),
    [
        ("a.pcd", pcd("ascii", "y z intensity"), "y.*z.*intensity"),
        ("a.pcd", pcd("binary", "y z intensity"), "y.*z.*intensity"),
        ("a.ply", ply("ascii", "float y,float z"), "y.*z"),
        ("a.ply", ply("binary_big_endian", "float u,float v"), "u.*v"),
        ("a.npy", np.zeros(2, dtype=[("y", "f4"), ("z", "f4")]), "y.*z"),
    ],
)
def test_a_cloud_without_x_is_told_with_its_fields_and_what_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: Any, fields: str
) -> None:
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else npy(path, data))
    assert main(["scene", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line
    assert line.endswith("x, y and z are needed")
    with pytest.raises(CoAdaptError, match=fields):
        read_scan(path)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.bin", FOUR.tobytes()[:-1], "47 bytes; it must be 16 bytes a point"),
        ("a.bin", np.repeat(POINTS, 4, axis=0).tobytes(), "negative numbers in the place"),
        ("a.pcd.bin", FOUR.tobytes(), "20 bytes a point"),
        ("a.ply", b"end_header", "no PLY header"),
        ("a.npy", b"nothing", "cannot be read"),
        ("a.npy", npy_header("{'descr': '<f4', 'shape': '''(2, 3), }"), "header is malformed"),
        ("a.npy", npy_header("{'descr': '<f4', 'shape': (2, 3), ("), "header is malformed"),
        ("a.npy", npy_header("{'descr': '<f4', b'shape': (2, 3)}"), "header is malformed"),
        ("a.npy", npy_header("{'descr': (), 'fortran_order': False, 'shape': (2,)}"), "malformed"),
        (
            "a.npy",
            npy_header(f"{{'descr': '<f4', 'fortran_order': False, 'shape': (0, {10**40}), }}"),
            "header is malformed",
        ),
        (
            "a.npy",
            npy_header("{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999, 3), }"),
            "it announces an array of",
        ),
        ("a.txt", b"1 2 3", r"no known kind; allowed: \.pcd, \.bin, \.ply, \.npy"),
        ("a.ply", b"plywood", "no PLY header"),
        ("a.ply", b"", "no PLY header"),
        ("a.ply", ply("ascii").replace(b"ascii", b"morse"), "malformed header"),
        ("a.ply", ply("ascii").replace(b"vertex 3", b"vertex -3"), "malformed header"),
        ("a.ply", ply("ascii", "list uchar int x,float y,float z"), "x, y and z are needed"),
        ("a.ply", ply("ascii", "float x,float y,float z,list uchar int n"), "list in its element"),
        ("a.ply", ply("ascii") + b"1 2 3\n", "announces 3 vertices of 3 numbers, holds 3"),
        ("a.ply", ply("ascii") + b"1 2 x\n", "no number"),
        ("a.ply", ply("binary_little_endian") + bytes(8), "holds 8 bytes"),
        (
            "a.ply",
            ply("binary_little_endian", before=OTHERS).replace(b"vertex 3", b"vertex 0") + b"\x01",
            "after 8 bytes of other elements, holds 1 bytes",
        ),
        ("a.pcd", pcd("binary_compressed") + b"\x01", "not well compressed"),
        ("b.pcd", pcd("binary_compressed") + b"\x02\0\0\0\x24\0\0\0\xff\xff", "not well"),
    ],
)
def test_a_broken_file_is_named_with_what_is_wrong(
    tmp_path: Path, name: str, data: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(CoAdaptError, match=words) as error:
        read_scan(path)
    assert str(path) in str(error.value)


def test_a_pickle_is_not_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(CoAdaptError, match="cannot be read"):
        read_scan(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (np.zeros((4, 9)), r"shape \(4, 9\); allowed: \(N, 3\)"),
        (np.zeros(3), r"shape \(3,\)"),
        ([[1, 2, 3], [4, 5]], "no table of numbers"),
        ([["a", "b", "c"]], "numbers are needed"),
    ],
)
def test_what_is_no_cloud_is_said(source: Any, words: str) -> None:
    with pytest.raises(ScanError, match=words):
        read_scan(source)
