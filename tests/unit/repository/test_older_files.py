"""Files that older programs left in `var/` and elsewhere are read as before.

Each was written by the program of its time, and none is ever changed: a form that changes gets one
more file.
"""

from __future__ import annotations

import shutil
import tomllib
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from coadapt.main import main
from deploy.state import STATE_FILE, need_state
from ego_agent.knowledge.compute import read_compute
from ego_agent.knowledge.journal import Journal, read_journal
from ego_agent.knowledge.quality import read_quality
from ego_agent.plan.intents.given import Intents
from ego_agent.settings import EgoSettings
from llm_gateway.cache_store import Store
from llm_gateway.settings import GatewaySettings
from network_controller.model import Link
from network_controller.settings import ControllerSettings
from network_controller.wishes import Wishes
from options.bags.settings import read_settings
from options.console.settings import ConsoleSettings
from options.recordings.file import RecordingFile
from options.recordings.format import FRAME, Frame
from options.recordings.world import RecordingWorld
from robot_agent.settings import RobotSettings
from swarm.log import make_logger
from swarm.settings import load
from swarm.site_file import read_site
from tests.support.paths import GOLDEN
from worlds.world_file import FILE_NAME

OLDER = GOLDEN / "older"
LOG = make_logger("test", level="critical")
START_NS = 1_780_000_000_000_000_000


def a_copy(name: str, folder: Path) -> Path:
    """One of the files, which readers may write to."""
    return Path(shutil.copy(OLDER / name, folder / name))


JOURNALS = ("journal-1.jsonl", "journal-2.jsonl", "journal-3.jsonl", "journal-4.jsonl")
"""Of the first program; with advice and demand; with rates, deadlines and arrivals; with wishes."""


@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_is_read_told_and_gone_on_with(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = a_copy(name, tmp_path)
    records = list(read_journal(path))
    assert [record.cycle for record in records] == [1, 2]
    for record, line in zip(records, path.read_text().splitlines(), strict=True):
        kept = msgspec.to_builtins(record)
        for field, value in msgspec.json.decode(line).items():
            assert holds(kept[field], value), field
    assert main(["why", "--journal", str(path)]) == 0
    assert "early" in capsys.readouterr().out
    with closing(Journal(path)) as journal:
        assert journal.next_cycle == 3
        assert journal.totals[("R3", "early")] == 300
        journal.commit(msgspec.structs.replace(records[1], cycle=3))
    assert [record.cycle for record in read_journal(path)] == [1, 2, 3]


def holds(read: Any, written: Any) -> bool:
    """Whether all that was written has been read; what was not has its default."""
    if isinstance(written, dict):
        return all(name in read and holds(read[name], value) for name, value in written.items())
    if isinstance(written, list):
        return len(read) == len(written) and all(map(holds, read, written))
    return bool(read == written)


def test_a_journal_in_parts_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "journal-parts.jsonl"
    for part in OLDER.glob("journal-parts.jsonl*"):
        a_copy(part.name, tmp_path)
    cycles = [record.cycle for record in read_journal(path)]
    assert cycles == [1, 2, 3, 4, 5, 6]
    with closing(Journal(path)) as journal:
        assert journal.next_cycle == 7
        assert journal.totals[("R3", "early")] == 100 * sum(cycles)


@pytest.mark.parametrize(("name", "version"), [("recording-1.mcap", 1), ("recording-2.mcap", 2)])
def test_a_recording_is_read_and_fuses(
    name: str, version: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the first form, with whole clouds, and of the one with ranges."""
    file = RecordingFile(OLDER / name)
    assert file.header.version == version
    assert any(topic.endswith("/ranges") for topic in file.topics) is (version == 2)
    world = RecordingWorld(OLDER / name)
    frame = file.message(FRAME, file.times(FRAME)[0], Frame)
    for robot in ("R1", "R2"):
        points = world.scan(robot, 0).points
        assert len(points) == frame.robots[robot].points
        assert np.isfinite(points).all()
    assert main(["fuse", str(OLDER / name), "--frame", "0", "--algorithm", "late", "--json"]) == 0
    assert msgspec.json.decode(capsys.readouterr().out)["boxes"]
    assert main(["replay", str(OLDER / name), "--json"]) == 0
    assert msgspec.json.decode(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["state-1.json", "state-2.json"])
def test_commands_find_a_swarm_that_an_older_program_has_started(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    (tmp_path / "local").mkdir()
    shutil.copy(OLDER / name, tmp_path / "local" / STATE_FILE)
    state = need_state("local")
    written = msgspec.json.decode((OLDER / name).read_bytes())
    assert holds(msgspec.to_builtins(state), written)
    assert state.spec.all_egos == ("R1",)


def test_shapes_of_an_older_controller_are_in_force(tmp_path: Path) -> None:
    wishes = Wishes(a_copy("shapes-1.json", tmp_path), START_NS)
    assert wishes.revision == 3
    now = {str(wish.robot): wish.rate_bps(START_NS) for wish in wishes}
    assert set(now) == {"R1", "R2", "R3"}
    assert (now["R1"], now["R2"]) == (2_000_000, 4_000_000)
    kept = wishes.get(Link("R1", "down"))
    assert kept is not None
    assert (kept.delay_ms, kept.loss, kept.operator) == (5.0, 0.01, "anna")
    wishes.drop(Link("R2", "up"))
    wishes.changed()
    later = Wishes(tmp_path / "shapes-1.json", START_NS + 11_000_000_000)
    assert (later.revision, [wish.robot for wish in later]) == (4, ["R1"])


def test_wishes_that_an_older_ego_kept_are_in_force(tmp_path: Path) -> None:
    intents = Intents("R1", a_copy("intents-1.json", tmp_path), LOG)
    one, two = intents.all()
    assert (one.number, one.operator, one.intent.exclude) == (1, "ann", ("R3",))
    assert [place.name for place in one.places] == ["docks"]
    assert (two.intent.q_min, two.intent.link_share, two.intent.policy) == (0.8, 0.5, "static-late")
    assert intents.standing(START_NS + 1).intents == (one, two)
    intents.withdraw(1, "ann")
    assert Intents("R1", tmp_path / "intents-1.json", LOG).all() == (two,)


def test_a_gateway_goes_on_with_an_older_cache(tmp_path: Path) -> None:
    path = a_copy("answers-1.sqlite3", tmp_path)
    with closing(Store(path, 100)) as store:
        older = store.load(0.0)
        assert [entry.key[0] for entry in older] == ["1", "2"]
        assert all(entry.tokens.prompt == 900 and entry.text[0] == "{" for entry in older)
        store.put(replace(older[0], key="3" * 64, made_at=older[1].made_at + 1), 0.0)
        assert [entry.key[0] for entry in store.load(0.0)] == ["1", "2", "3"]
        assert store.moved_aside == 0


def test_a_site_file_is_read() -> None:
    docks, gate = read_site(OLDER / "site-1.json").places
    assert (docks.name, docks.polygon[0]) == ("docks", (8.4, 20.8))
    assert gate.name == "Tor 1 \N{EN DASH} Süd"


def test_a_scene_file_is_decided_on(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decide", str(OLDER / "scene-1.json")]) == 0
    decision = msgspec.json.decode(capsys.readouterr().out)
    assert decision["valid"]
    assert decision["participants"][0] == "R1"


def test_models_of_quality_and_compute_are_read() -> None:
    quality = read_quality(OLDER / "quality-1.json")
    assert {"factory", "road"} <= set(quality)
    compute = read_compute(OLDER / "compute-1.json")
    assert set(compute.detectors) == {"factory", "road"}


def test_what_is_said_of_recorded_data_is_read(tmp_path: Path) -> None:
    shutil.copy(OLDER / "world-1.toml", tmp_path / FILE_NAME)
    settings = read_settings(tmp_path, ("R1", "R2"))
    written = tomllib.loads((OLDER / "world-1.toml").read_text())
    assert holds(msgspec.to_builtins(settings), written)
    assert settings.robot("R2", tmp_path).odometry == "/wheels/odom"


SETTINGS: dict[str, type[msgspec.Struct]] = {
    "settings-robot-1.toml": RobotSettings,
    "settings-ego-1.toml": EgoSettings,
    "settings-controller-1.toml": ControllerSettings,
    "settings-gateway-1.toml": GatewaySettings,
    "settings-console-1.toml": ConsoleSettings,
}


@pytest.mark.parametrize(("name", "kind"), SETTINGS.items(), ids=SETTINGS)
def test_every_setting_of_an_older_file_has_its_effect(
    name: str, kind: type[msgspec.Struct]
) -> None:
    values = tomllib.loads((OLDER / name).read_text())
    settings = load(kind, {"COADAPT_CONFIG": str(OLDER / name)})
    assert holds(msgspec.to_builtins(settings), values)


def test_each_of_the_files_is_read_by_a_test() -> None:
    named = Path(__file__).read_text()
    kept = {path.name for path in OLDER.iterdir() if path.suffix != ".msgpack"}
    assert {name for name in kept if name.partition(".jsonl.")[0] not in named} == set()
