"""`coadapt picture`, `coadapt train` and the fusion in docs/perception.md, as a user meets them."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import torch

from coadapt.main import main
from perception.detector.weight_files import has_weights
from perception.fusion import algorithms
from tests.support.paths import REPOSITORY
from worlds.cooperative.fusing import fuse_frame
from worlds.factory.world import FactoryWorld

DOCS = REPOSITORY / "docs"


def test_a_picture_shows_points_and_boxes_and_repeats(tmp_path: Path) -> None:
    files = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for file in files:
        options = ["--robots", "3", "--algorithm", "late", "--participants", "R2"]
        assert main(["picture", "factory", *options, "--output", str(file)]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    root = ElementTree.parse(files[0]).getroot()
    paths = [node for node in root if node.tag.endswith("path")]
    # Two clouds, true boxes, found boxes, the ego.
    assert len(paths) == 5
    assert all(path.get("d") for path in paths)
    assert "2 robots, 50 x 50 m" in "".join(root.itertext())


def test_a_picture_of_what_was_found_shows_nothing_of_the_recording(tmp_path: Path) -> None:
    file = tmp_path / "found.svg"
    options = ["--robots", "3", "--algorithm", "late", "--only-found", "--output", str(file)]
    assert main(["picture", "factory", *options]) == 0
    root = ElementTree.parse(file).getroot()
    text = "".join(root.itertext())
    words = re.search(r"3 robots, 50 x 50 m; (\d+) boxes found alone, (\d+) together", text)
    assert words is not None
    assert 0 < int(words[1]) <= int(words[2])
    paths = [node.get("d", "") for node in root if node.tag.endswith("path")]
    # The senders, boxes found alone, boxes found together, the ego.
    assert len(paths) == 4
    assert paths[0].count("z") == 2
    assert "true boxes" not in text


def test_pictures_of_the_documentation_are_small_enough_to_keep() -> None:
    pictures = list((DOCS / "pictures").glob("*.svg"))
    assert {picture.name for picture in pictures} >= {"factory.svg", "road.svg", "opv2v.svg"}
    for picture in pictures:
        ElementTree.parse(picture)
        assert picture.stat().st_size < 200_000


def test_a_recorded_world_needs_its_directory(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["picture", "opv2v", "--output", "never.svg"]) == 1
    assert "opv2v" in capsys.readouterr().err


@pytest.mark.skipif(not has_weights("factory"), reason="no weights for the factory")
def test_the_fusion_of_the_documentation_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = re.search(r"```python\n(.*?)```", (DOCS / "perception.md").read_text(), re.DOTALL)
    assert code is not None
    (tmp_path / "intermediate_mean.py").write_text(code[1])
    monkeypatch.setattr(algorithms, "__path__", [*algorithms.__path__, str(tmp_path)])
    try:
        fused = fuse_frame(FactoryWorld(robots=2), 10, "R1", ["R2"], "intermediate-mean")
    finally:
        sys.modules.pop(f"{algorithms.__name__}.intermediate_mean", None)
        vars(algorithms).pop("intermediate_mean", None)
    assert fused.rejected == {}
    assert fused.bytes["R2"] > 0


def test_training_refuses_what_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ["--folder", str(tmp_path)]
    assert main(["train", "--config", "moon", *folder]) == 1
    assert "no training plan 'moon'; allowed: factory" in capsys.readouterr().err
    if not torch.cuda.is_available():
        assert main(["train", "--config", "factory", "--device", "cuda", *folder]) == 1
        assert "device 'cuda' is not available" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["train", "--config", "factory", "--steps", "0"])
    assert list(tmp_path.iterdir()) == []


def test_a_finished_run_says_how_to_install_its_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Learning the codebook takes sixty batches more.
    codebook = np.zeros((4, 256, 8), dtype=np.float32)
    monkeypatch.setattr("research.training.run.codebook_of", lambda plan, tensors: codebook)
    assert main(["train", "--config", "factory", "--steps", "1", "--folder", str(tmp_path)]) == 0
    weights = tmp_path / "weights.safetensors"
    assert weights.is_file()
    assert f"cp {weights} " in capsys.readouterr().out
