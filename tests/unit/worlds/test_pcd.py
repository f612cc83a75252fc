"""PCD files: ascii and binary, and what is said about broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from swarm.errors import WorldError
from worlds.clouds.pcd import read_pcd

POINTS = np.array([[1.5, -2.25, 3.0], [4.0, 5.5, -6.125]], dtype=np.float32)


def header(kind: str, count: int = 2, fields: str = "x y z rgb") -> str:
    width = len(fields.split())
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {' '.join(['4'] * width)}\n"
        f"TYPE {' '.join(['F'] * width)}\nCOUNT {' '.join(['1'] * width)}\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {kind}\n"
    )


def write(path: Path, head: str, body: bytes) -> Path:
    path.write_bytes(head.encode() + body)
    return path


def test_ascii_points_are_read_by_field_name(tmp_path: Path) -> None:
    body = b"1.5 -2.25 3 0\n4 5.5 -6.125 1.2e-38\n"
    assert np.array_equal(read_pcd(write(tmp_path / "a.pcd", header("ascii"), body)), POINTS)


def test_binary_points_are_read_whatever_the_order_of_fields(tmp_path: Path) -> None:
    records = np.column_stack([np.zeros(2), POINTS[:, 2], POINTS[:, 0], POINTS[:, 1]])
    path = write(
        tmp_path / "b.pcd", header("binary", fields="i z x y"), records.astype("<f4").tobytes()
    )
    assert np.array_equal(read_pcd(path), POINTS)


def test_nan_points_are_kept_for_the_caller_to_judge(tmp_path: Path) -> None:
    points = read_pcd(write(tmp_path / "n.pcd", header("ascii", 1), b"nan 0 1 0\n"))
    assert np.isnan(points[0, 0])


def test_numbers_beyond_float32_become_infinite(tmp_path: Path) -> None:
    points = read_pcd(write(tmp_path / "a.pcd", header("ascii", 1), b"1e60 0 1 0\n"))
    assert np.isinf(points[0, 0])
    wide = header("binary", 1, "x y z").replace("SIZE 4 4 4", "SIZE 8 8 8")
    points = read_pcd(write(tmp_path / "b.pcd", wide, np.array([1e60, 0, 1]).tobytes()))
    assert np.isinf(points[0, 0])


@pytest.mark.parametrize(
    ("head", "body", "words"),
    [
        ("", b"no header at all", "no PCD header"),
        (header("ascii"), b"1 2 3 4\n", "announces 2 points"),
        (header("ascii"), b"1 2 3 four\n5 6 7 8\n", "no number"),
        (header("binary"), b"\x00" * 31, "holds 31 bytes"),
        (header("zip"), b"", "allowed: ascii, binary"),
        (header("ascii", fields="x y"), b"1 2\n3 4\n", "x, y and z"),
        (header("ascii").replace("POINTS 2", "POINTS -2"), b"", "POINTS '-2'"),
        (header("ascii").replace("POINTS 2", "POINTS 99999999999"), b"", "12000000"),
        (header("binary").replace("COUNT 1", "COUNT 0"), b"\x00" * 32, "COUNT 1"),
        (header("binary").replace("SIZE 4 4 4 4", "SIZE 3 4 4 4"), b"\x00" * 32, "malformed"),
    ],
)
def test_a_broken_file_is_named_with_what_is_wrong(
    tmp_path: Path, head: str, body: bytes, words: str
) -> None:
    path = write(tmp_path / "broken.pcd", head, body)
    with pytest.raises(WorldError, match=words) as error:
        read_pcd(path)
    assert str(path) in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"nowhere\.pcd cannot be read"):
        read_pcd(tmp_path / "nowhere.pcd")
