"""`coadapt data`, from a git repository of the same shape; and where the sample is found."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import pytest

from coadapt.main import main
from coadapt.sample_source import FOLDER, SCENARIO, Source, bring, place_in
from swarm.errors import WorldError
from worlds import sample
from worlds.opv2v.world import Opv2vWorld
from worlds.sample import data_folder, opv2v_sample

PCD = (
    "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n1 2 3 0\n4 5 {last} 0\n"
)
DESCRIPTION = "lidar_pose: [0, 0, 1.9, 0, 0, 0]\nvehicles: {}\n"
FRAMES = ("006220", "006222")
WAIT_S = 60.0


def git(folder: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=test", "-c", "user.email=test@example.org")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    return subprocess.run(
        ["git", *identity, *arguments],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()


def write_scenario(folder: Path, last: str = "6") -> Path:
    """Two vehicles of two frames in OPV2V's layout, images, and a last scan without description."""
    for vehicle in ("302", "311"):
        (folder / vehicle).mkdir(parents=True)
        for frame in FRAMES:
            (folder / vehicle / f"{frame}.pcd").write_text(PCD.format(last=last))
            (folder / vehicle / f"{frame}.yaml").write_text(DESCRIPTION)
            (folder / vehicle / f"{frame}_camera0.png").write_bytes(b"image")
        (folder / vehicle / "006292.pcd").write_text(PCD.format(last=last))
    (folder / "data_protocol.yaml").write_text("world: {}\n")
    return folder


def repository(folder: Path, last: str = "6") -> Source:
    """A repository of the shape of CoAdapt's own, with one commit."""
    write_scenario(folder / FOLDER, last)
    (folder / "LICENSE").write_text("The MIT License\n\nCopyright (c) 2026 Somebody\n")
    (folder / "README.md").write_text("Not part of the sample.\n")
    git(folder, "init", "--quiet")
    git(folder, "config", "uploadpack.allowFilter", "true")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "Add everything")
    return Source(
        folder.as_uri(),
        git(folder, "rev-parse", "HEAD"),
        git(folder, "rev-parse", f"HEAD:{FOLDER}"),
    )


@pytest.fixture
def source(tmp_path: Path) -> Source:
    return repository(tmp_path / "source")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """$COADAPT_DATA, without anything else that might hold the sample."""
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path / "home"))
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    (checkout / "pyproject.toml").touch()
    monkeypatch.setattr(sample, "REPOSITORY", checkout)
    return tmp_path / "home"


def options(source: Source) -> list[str]:
    return ["data", "--url", source.url, "--commit", source.commit, "--tree", source.tree]


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def assert_nothing_was_put(home: Path) -> None:
    assert files_of(home) == set()
    assert not list(home.glob("*.partial-*"))


def test_scans_and_descriptions_come_with_licence_and_source(
    source: Source, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(options(source)) == 0
    place = home / "opv2v-sample" / SCENARIO
    scans = {f"{v}/{frame}.pcd" for v in ("302", "311") for frame in (*FRAMES, "006292")}
    texts = {f"{v}/{frame}.yaml" for v in ("302", "311") for frame in FRAMES}
    own = {"data_protocol.yaml", "LICENSE", "source.json"}
    assert files_of(place) == scans | texts | own
    assert not list(home.glob("*.partial-*"))
    out = capsys.readouterr().out
    assert "vehicles 302, 311; 2 frames" in out
    assert f"{source.url}, {FOLDER} at {source.commit}" in out
    assert "The MIT License, Copyright (c) 2026 Somebody" in out
    assert "UCLA Mobility Lab" in out
    assert opv2v_sample() == place
    assert Opv2vWorld(place).frame_names == FRAMES


def test_a_sample_that_is_there_is_not_brought_again(source: Source, home: Path) -> None:
    assert bring(source, home)
    shutil.rmtree(source.url.removeprefix("file://"))
    assert not bring(source, home)


def test_a_damaged_or_another_sample_is_brought_anew(
    source: Source, home: Path, tmp_path: Path
) -> None:
    assert bring(source, home)
    scan = place_in(home) / "302" / "006220.pcd"
    whole = scan.read_text()
    scan.write_text(whole[:-5])
    assert bring(source, home)
    assert scan.read_text() == whole
    other = repository(tmp_path / "other", last="7")
    assert bring(other, home)
    assert scan.read_text() == PCD.format(last="7")
    assert not list(home.glob("*.partial-*"))


def test_another_commit_with_the_same_folder_will_do(source: Source, home: Path) -> None:
    folder = Path(source.url.removeprefix("file://"))
    (folder / "README.md").write_text("Changed.\n")
    git(folder, "commit", "--quiet", "--all", "--message", "Change the README")
    assert bring(Source(source.url, "HEAD", source.tree), home)


def test_a_folder_of_another_tree_is_refused(
    source: Source, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = Source(source.url, source.commit, "0" * 40)
    assert main(options(wrong)) == 1
    words = capsys.readouterr().err
    assert f"its git tree is {source.tree}, and {wrong.tree} was expected" in words
    assert_nothing_was_put(home)


def test_a_repository_without_the_folder_is_named(source: Source, home: Path) -> None:
    folder = Path(source.url.removeprefix("file://"))
    git(folder, "mv", FOLDER, "elsewhere")
    git(folder, "commit", "--quiet", "--message", "Move it")
    with pytest.raises(WorldError, match=f"has no folder {FOLDER} at"):
        bring(Source(source.url, "HEAD", source.tree), home)
    assert_nothing_was_put(home)


def test_a_scan_that_cannot_be_read_is_not_put_in_place(tmp_path: Path, home: Path) -> None:
    with pytest.raises(WorldError, match=r"006220\.pcd"):
        bring(repository(tmp_path / "damaged", last="six"), home)
    assert_nothing_was_put(home)


def test_without_a_source_the_way_by_hand_is_said(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = Source((tmp_path / "nowhere").as_uri(), "1" * 40)
    assert main(options(missing)) == 1
    words = capsys.readouterr().err
    assert f"git clone --filter=blob:none --no-checkout {missing.url} sample" in words
    assert f"git checkout {missing.commit}" in words
    assert f"copy the folder {FOLDER} to {place_in(home)}" in words
    assert_nothing_was_put(home)


def test_without_git_it_says_what_to_install(
    source: Source,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(WorldError, match="apt-get install git"):
        bring(source, home)
    assert_nothing_was_put(home)


def test_after_being_killed_it_starts_clean(source: Source, home: Path, tmp_path: Path) -> None:
    # A git that stops when the files would come, as on a line that has gone dead.
    slow, reached = tmp_path / "bin" / "git", tmp_path / "reached"
    slow.parent.mkdir()
    slow.write_text(
        f'#!/bin/sh\ncase "$*" in *" checkout "*) touch {reached}; exec sleep {WAIT_S:.0f};; esac\n'
        f'exec {shutil.which("git")} "$@"\n'
    )
    slow.chmod(0o755)
    environment = {**os.environ, "PATH": f"{slow.parent}:{os.environ['PATH']}"}
    command = [sys.executable, "-m", "coadapt.main", *options(source)]
    process = subprocess.Popen(command, env=environment, start_new_session=True)
    try:
        deadline = time.monotonic() + WAIT_S
        while not reached.exists():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert list(home.glob("opv2v-sample.partial-*"))
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    with pytest.raises(WorldError, match="`make data`"):
        opv2v_sample()
    assert bring(source, home)
    assert opv2v_sample() == place_in(home)
    assert not list(home.glob("*.partial-*"))


def test_two_at_once_do_not_get_in_each_others_way(source: Source, home: Path) -> None:
    folder = place_in(home).parent
    folder.mkdir(parents=True)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        with pytest.raises(WorldError, match="another process brings the sample"):
            bring(source, home)
    finally:
        os.close(descriptor)
    assert bring(source, home)


def test_a_folder_put_there_by_hand_is_read_and_left_as_it_is(
    source: Source, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = write_scenario(place_in(home))
    before = files_of(place)
    assert main(options(source)) == 0
    assert "put there by hand" in capsys.readouterr().out
    assert files_of(place) == before
    (place / "311" / "006222.pcd").write_text("half a file")
    assert main(options(source)) == 1
    assert "006222.pcd" in capsys.readouterr().err


def test_a_place_that_cannot_be_written_is_named(source: Source, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WorldError, match="cannot be put into"):
        bring(source, tmp_path / "file")


def pack(folder: Path) -> None:
    folder.mkdir(parents=True)
    scenario = write_scenario(folder / "test" / SCENARIO)
    with tarfile.open(folder / "opv2v-sample.tar.xz", "w:xz") as packed:
        packed.add(scenario, f"test/{SCENARIO}")
    shutil.rmtree(folder / "test")


def test_the_sample_is_looked_for_in_order(home: Path, tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="`make data`"):
        opv2v_sample()
    pack(tmp_path / "shared" / "data" / "opv2v-sample")
    beside = opv2v_sample()
    assert beside.is_relative_to(tmp_path / "checkout" / "var" / "data")
    assert Opv2vWorld(beside).robots == ("302", "311")
    assert opv2v_sample() == beside, "it is unpacked once"
    brought = write_scenario(place_in(tmp_path / "checkout" / "var" / "data"))
    assert opv2v_sample() == brought
    named = write_scenario(place_in(home))
    assert opv2v_sample() == named


def test_half_an_archive_is_named_and_leaves_nothing(home: Path, tmp_path: Path) -> None:
    pack(home / "opv2v-sample")
    archive = home / "opv2v-sample" / "opv2v-sample.tar.xz"
    archive.write_bytes(archive.read_bytes()[:200])
    with pytest.raises(WorldError, match=r"opv2v-sample\.tar\.xz cannot be unpacked"):
        opv2v_sample()
    assert list((tmp_path / "checkout" / "var" / "data").iterdir()) == []


@pytest.mark.parametrize("name", ["../outside", "/tmp/outside", "link"])
def test_an_archive_that_reaches_out_of_its_place_is_refused(
    home: Path, tmp_path: Path, name: str
) -> None:
    folder = home / "opv2v-sample"
    folder.mkdir(parents=True)
    with tarfile.open(folder / "opv2v-sample.tar.xz", "w:xz") as packed:
        member = tarfile.TarInfo(name)
        if name == "link":
            member.type, member.linkname = tarfile.SYMTYPE, "/etc"
        packed.addfile(member)
    with pytest.raises(WorldError, match=r"opv2v-sample\.tar\.xz"):
        opv2v_sample()
    assert list((tmp_path / "checkout" / "var" / "data").iterdir()) == []


def test_other_data_is_found_beside_a_sample_that_was_brought(home: Path, tmp_path: Path) -> None:
    write_scenario(place_in(home))
    traces = tmp_path / "shared" / "data" / "traces"
    traces.mkdir(parents=True)
    assert data_folder(Path("traces")) == traces
    assert data_folder(Path("nothing")) is None


def test_an_installation_without_checkout_uses_the_current_directory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("COADAPT_DATA", raising=False)
    monkeypatch.setattr(sample, "REPOSITORY", tmp_path / "site-packages")
    monkeypatch.chdir(tmp_path)
    assert sample.data_home() == tmp_path / "var" / "data"
    scenario = write_scenario(place_in(sample.data_home()))
    assert opv2v_sample() == scenario


@pytest.mark.parametrize(
    "command",
    [
        ["ap", "--algorithm", "late"],
        ["fuse", "--frame", "0", "--algorithm", "late"],
    ],
)
def test_commands_without_a_sample_name_what_brings_it(
    command: list[str], home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command) == 1
    assert "no OPV2V sample in" in (words := capsys.readouterr().err)
    assert "`make data` (`coadapt data`) brings it" in words


def test_fuse_without_a_directory_takes_the_sample(
    opv2v_dir: Path, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "opv2v-sample").mkdir(parents=True)
    shutil.copytree(opv2v_dir, home / "opv2v-sample" / opv2v_dir.name)
    assert main(["fuse", "--frame", "006224", "--algorithm", "late", "--json"]) == 0
    assert '"311"' in capsys.readouterr().out
