"""`coadapt ap`, `fuse`, `picture` and `scene` take a recording as they take a data set."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from coadapt.main import main
from coadapt.recorded import open_recorded
from swarm.errors import WorldError
from tests.support.plain_scans import plain_scans
from tests.support.recording_files import write_recording
from worlds.cooperative.judging import tallied
from worlds.factory.world import FactoryWorld

NUMBERS = (40, 42, 46)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recorded") / "run.mcap", NUMBERS)


@pytest.mark.stumble(
    "ap does not read a recording", command="coadapt ap run.mcap --algorithm early"
)
def test_ap_of_a_recording_is_that_of_the_recorded_frames(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ap", str(recording), "--algorithm", "early", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    world = FactoryWorld(robots=3, rings=16)
    expected = tallied(world, "early", "R1", frames=NUMBERS).precision()
    assert told["frames"] == 3, "a frame that stands in for a missing one is not judged"
    assert told["ground_truth"] == expected.ground_truth > 0
    assert told["ap_50"] == pytest.approx(expected.ap_50, abs=1e-4)
    classes = told["classes"]
    assert len(classes) > 1
    assert sum(of_class["ground_truth"] for of_class in classes.values()) == told["ground_truth"]
    assert main(["ap", str(recording), "--algorithm", "early"]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert float(lines["ap_50"]) == told["ap_50"]
    for label, of_class in classes.items():
        assert f"ap_70 {of_class['ap_70']}  " in lines[label]


@pytest.mark.stumble(
    "fuse does not read a recording", command="coadapt fuse run.mcap --algorithm late --frame 2"
)
def test_a_frame_of_a_recording_is_fused(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--algorithm", "late", "--participants", "R2", "--json"]
    assert main(["fuse", str(recording), "--frame", "2", *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["bytes"]) == {"R2"}
    data = open_recorded(recording)
    assert data.world.pose("R1", data.frame("2")) == FactoryWorld(robots=3).pose("R1", 46)
    assert main(["fuse", str(recording), "--frame", "3", *options]) == 1
    assert "run.mcap; it has 0 to 2" in capsys.readouterr().err


@pytest.mark.stumble("scene does not read a recording", command="coadapt scene run.mcap")
def test_a_scan_of_a_recording_is_described(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan = FactoryWorld(robots=3, rings=16).scan("R2", 42)
    assert main(["scene", str(recording), "--robot", "R2", "--frame", "1"]) == 0
    assert f"ground points of {len(scan.points)}," in capsys.readouterr().out
    assert main(["scene", str(recording), "--robot", "R9"]) == 1
    assert "robot 'R9' is not in recording" in capsys.readouterr().err


@pytest.mark.stumble(
    "picture does not read a recording", command="coadapt picture run.mcap --output run.png"
)
def test_a_frame_of_a_recording_is_drawn(recording: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.svg"
    assert main(["picture", str(recording), "--algorithm", "late", "--output", str(file)]) == 0
    assert "3 robots, 50 x 50 m" in file.read_text()


def test_a_recording_without_truth_has_no_precision(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from options.recordings.scans import Scans

    monkeypatch.setattr(Scans, "_write_truth", lambda *given: None)
    path = write_recording(tmp_path / "blind.mcap", (40,))
    assert main(["ap", str(path), "--algorithm", "late"]) == 1
    assert "of 3 robots and does not say what was really there" in capsys.readouterr().err


def test_a_recording_of_those_who_were_asked_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_recording(tmp_path / "some.mcap", (40,), robots=4, points="selected")
    assert main(["ap", str(path), "--algorithm", "late"]) == 0
    assert "robots that were not asked have no scan" in capsys.readouterr().err
    assert main(["scene", str(path), "--robot", "R4"]) == 1
    assert "holds no scan of R4 in frame 0" in capsys.readouterr().err


@pytest.mark.stumble(
    "a recording cut in the middle", command="coadapt ap cut.mcap --algorithm late"
)
def test_a_recording_cut_in_the_middle_is_read_up_to_the_cut_and_says_so(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    frames = 0
    for share in (0.9, 0.8, 0.7, 0.6, 0.5):
        cut.write_bytes(whole[: int(share * len(whole))])
        frames = len(open_recorded(cut).frames)
        if frames < len(NUMBERS):
            break
    assert 0 < frames < len(NUMBERS)
    assert main(["ap", str(cut), "--algorithm", "late", "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["frames"] == frames
    assert "cut.mcap is cut off" in told.err
    assert "what comes before is used" in told.err


def test_what_is_no_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"nowhere\.mcap is not there"):
        open_recorded(tmp_path / "nowhere.mcap")
    text = tmp_path / "notes.txt"
    text.write_text("hello")
    with pytest.raises(WorldError, match=r"holds no data that is known(.|\n)*is not an MCAP file"):
        open_recorded(text)


@pytest.mark.stumble("--check shows no progress", command="coadapt replay run.mcap --check")
def test_replay_tells_how_far_it_is(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(recording), "--check"]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines()[0].strip() == "1 of 3 frames"
    assert told.err.splitlines()[-1].strip() == "3 of 3 frames"
    assert "check    3 of 3 frames" in told.out


@pytest.mark.stumble(
    "fuse says nothing of a detector that does not suit", command="coadapt fuse cars --frame 0"
)
def test_a_detector_that_does_not_suit_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = plain_scans(tmp_path / "data")
    (data / "world.toml").write_text('detector = "road"\n')
    assert main(["fuse", str(data), "--frame", "0"]) == 0
    said = capsys.readouterr().err
    assert "detector road does not suit the scans: " in said


def test_a_picture_of_data_without_truth_counts_no_true_boxes(tmp_path: Path) -> None:
    data, picture = plain_scans(tmp_path / "data"), tmp_path / "picture.svg"
    assert main(["picture", str(data), "--frame", "0", "--output", str(picture)]) == 0
    text = picture.read_text()
    assert "true boxes not known" in text
    assert "0 true boxes" not in text
