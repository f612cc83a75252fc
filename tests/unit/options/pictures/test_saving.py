"""Pictures as PNG, SVG and PDF, by the file's ending."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from coadapt.main import main
from options.pictures.above import EGO, FOUND, Outlines, from_above
from options.pictures.picture import Picture
from options.pictures.saving import save
from perception.types import Boxes
from swarm.errors import PictureError

BOX = Boxes(
    centers=np.array([[10.0, 5.0, 1.0]]),
    sizes=np.array([[4.0, 2.0, 1.5]]),
    headings=np.array([0.0]),
    scores=np.array([0.9]),
    labels=("vehicle",),
)


@pytest.fixture
def picture() -> Picture:
    """A box 10 m ahead and 5 m to the left, and a wall of points behind."""
    wall = np.array([[-10.0, y, 0.0] for y in np.arange(-5, 5, 0.1)], dtype=np.float32)
    sensors = [(0.0, -8.0)]
    return from_above((20.0, 10.0), [wall], [Outlines(BOX, FOUND, 8)], [("a box", FOUND)], sensors)


@pytest.mark.stumble(
    "a picture is SVG whatever its name", command="coadapt picture factory --output a.png"
)
def test_the_ending_says_the_format(picture: Picture, tmp_path: Path) -> None:
    heads = {".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF-", ".svg": b"<svg "}
    for ending, head in heads.items():
        for name in ("a", "b"):
            save(picture, tmp_path / f"{name}{ending}")
        first, second = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("a", "b"))
        assert first.startswith(head)
        assert first == second, "a picture repeats"
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    assert "".join(root.itertext()).strip() == "a box"


def test_a_png_shows_everything_where_it_is(picture: Picture, tmp_path: Path) -> None:
    save(picture, tmp_path / "a.PNG")
    image = imread(tmp_path / "a.PNG", format="png")[:, :, :3]
    high, wide, _ = image.shape
    assert (wide, high) == (1200, 630)

    def seen(color: str, x: float, y: float, reach: int = 5) -> bool:
        """Whether a colour is near a place in metres."""
        ink = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
        column, row = round((x + 20) * 30), round((10 - y) * 30)
        part = image[max(0, row - reach) : row + reach, max(0, column - reach) : column + reach]
        return bool((np.abs(part - ink).max(axis=2) < 0.1).any())

    assert seen(FOUND, 12.0, 5.0)
    assert seen(FOUND, 8.0, 5.0)
    assert seen(FOUND, 10.0, 6.0)
    assert not seen(FOUND, 8.0, -5.0)
    assert seen(EGO, 0.1, 0.0)
    assert seen("#c47f00", 0.45, -8.0, 8)
    assert image[300, 300].min() < 0.9, "the wall"


@pytest.mark.stumble(
    "a picture makes directories", command="coadapt picture factory --output no/a.png"
)
def test_a_directory_that_is_not_there_is_not_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["picture", "factory", "--output", str(tmp_path / "no" / "a.png")]) == 1
    assert re.search(r"a\.png cannot be written: there is no directory .*no$", err(capsys))
    assert main(["picture", "factory", "--output", str(tmp_path / "a.gif")]) == 1
    assert "a.gif has no ending that says its format; allowed: .png, .svg, .pdf" in err(capsys)
    assert not list(tmp_path.iterdir())


def err(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.strip()


def test_what_cannot_be_written_is_named(picture: Picture, tmp_path: Path) -> None:
    (tmp_path / "a.svg").mkdir()
    with pytest.raises(PictureError, match=r"a\.svg cannot be written: Is a directory"):
        save(picture, tmp_path / "a.svg")


def test_without_matplotlib_a_png_says_what_brings_it(
    picture: Picture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "options.pictures.figure", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(PictureError, match=r"coadapt-edge\[figures\]"):
        save(picture, tmp_path / "a.png")
    save(picture, tmp_path / "a.svg")
