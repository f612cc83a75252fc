"""Kinds of bags: storages, compression, several files, and files that are damaged or cut off."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from options.bags.recording import Recording, find_bags
from options.bags.world import BagWorld
from swarm.errors import KeyspaceError, WorldError
from swarm.keyspace import check_name
from tests.support.bag_files import CLOUD, Log, plain_log

TIMES = np.arange(30) / 10
POINTS = np.random.default_rng(1).normal(size=(2000, 3)).astype(np.float32)
STORAGES = {"mcap": ".mcap", "sqlite3": ".db3"}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders `mcap` and `sqlite3`, each a whole bag with 30 scans of 48 kB."""
    folder = tmp_path_factory.mktemp("bags")
    log = plain_log(TIMES)
    log.rows = [row for row in log.rows if row[1] != CLOUD]
    log.scans(TIMES, POINTS)
    for storage in STORAGES:
        log.write(folder / storage, storage)
    return folder


def write_mcap(source: Recording, path: Path, options: dict[str, object]) -> Path:
    """The messages of a bag, written by another writer."""
    with path.open("wb") as file:
        writer = McapWriter(file, **options)  # type: ignore[arg-type]
        writer.start(profile="", library="test")
        for topic, kind in source.topics.items():
            schema = writer.register_schema(kind, "ros2msg", b"")
            channel = writer.register_channel(topic, "cdr", schema)
            messages = source.messages(topic)
            for i, time in enumerate(messages.times_ns.tolist()):
                raw = messages.decode(i, bytes)
                writer.add_message(channel, time, raw, time)
        writer.finish()
    return path


def clouds(bag: Path) -> int:
    """How many scans of a bag can be read."""
    messages = Recording(bag).messages("/points")
    return sum(messages.decode(i, len) > POINTS.nbytes for i in range(len(messages)))


@pytest.mark.parametrize(
    ("storage", "compress"),
    [
        ("mcap", ""),
        ("mcap", "storage"),
        ("mcap", "message"),
        ("sqlite3", ""),
        ("sqlite3", "message"),
    ],
)
def test_every_kind_of_bag_gives_the_same_scans(
    tmp_path: Path, storage: str, compress: str
) -> None:
    plain_log(TIMES).write(tmp_path / "R1", storage, compress)
    world = BagWorld(tmp_path)
    assert (world.robots, world.frame_count, world.notes) == (("R1",), 30, ())
    for frame in range(30):
        scan = world.scan("R1", frame)
        assert scan.points.tolist() == [[np.float32(TIMES[frame]), 1, 1]]
        assert scan.pose.x == pytest.approx(TIMES[frame] + 0.2)


def test_a_bag_compressed_file_by_file_is_refused(tmp_path: Path) -> None:
    plain_log(TIMES).write(tmp_path / "R1", "mcap", "file")
    with pytest.raises(WorldError, match=r"R1 is compressed file by file.*allowed: none and mess"):
        BagWorld(tmp_path)


def test_messages_in_big_endian_are_read(tmp_path: Path) -> None:
    plain_log(TIMES).write(tmp_path / "R1", order="big")
    assert BagWorld(tmp_path).scan("R1", 3).pose.x == pytest.approx(0.5)


@pytest.mark.parametrize("suffix", STORAGES.values())
def test_a_bare_file_is_a_bag(written: Path, tmp_path: Path, suffix: str) -> None:
    (source,) = written.glob(f"*/*{suffix}")
    shutil.copy(source, tmp_path / f"front{suffix}")
    world = BagWorld(tmp_path)
    assert world.robots == ("front",)
    assert np.array_equal(world.scan("front", 29).points, POINTS)


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"compression": CompressionType.LZ4, "chunk_size": 300},
        {"compression": CompressionType.ZSTD, "chunk_size": 300},
        {"compression": CompressionType.NONE, "chunk_size": 300},
        {"compression": CompressionType.LZ4, "use_summary_offsets": False, "use_statistics": False,
         "repeat_channels": False, "repeat_schemas": False},
        {"compression": CompressionType.ZSTD, "index_types": IndexType.NONE},
        {"compression": CompressionType.ZSTD, "index_types": IndexType.CHUNK},
    ],
)  # fmt: skip
def test_mcap_files_of_another_writer_are_read(tmp_path: Path, options: dict[str, object]) -> None:
    """Compressed or not, with and without chunks, summary and indexes."""
    source = Recording(plain_log(TIMES).write(tmp_path / "source"))
    folder = tmp_path / "bags"
    folder.mkdir()
    write_mcap(source, folder / "R1.mcap", options)
    world = BagWorld(folder)
    assert (world.frame_count, world.notes) == (30, ())
    assert [float(world.scan("R1", k).points[0, 0]) for k in (0, 7)] == pytest.approx([0, 0.7])


@pytest.mark.parametrize("storage", STORAGES)
def test_files_that_follow_each_other_are_one_bag(tmp_path: Path, storage: str) -> None:
    """As a recorder that splits its files names them: also 2 before 10, also without metadata."""
    bag = tmp_path / "bags" / "R1"
    bag.mkdir(parents=True)
    for number, begin in ((2, 0), (10, 15)):
        part = plain_log(TIMES[begin : begin + 15]).write(tmp_path / f"part{number}", storage)
        (file,) = part.glob(f"*{STORAGES[storage]}")
        shutil.copy(file, bag / f"R1_{number}{STORAGES[storage]}")
    world = BagWorld(bag.parent)
    assert world.frame_count == 30
    assert float(world.scan("R1", 20).points[0, 0]) == pytest.approx(2.0)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", [0.97, 0.6, 0.3])
def test_a_cut_off_bag_is_used_up_to_the_cut(
    written: Path, tmp_path: Path, storage: str, share: float
) -> None:
    bag = tmp_path / "R1"
    bag.mkdir()  # Without metadata.yaml, which a recorder writes at its end.
    (source,) = (written / storage).glob(f"*{STORAGES[storage]}")
    raw = source.read_bytes()
    (bag / source.name).write_bytes(raw[: int(len(raw) * share)])
    whole = clouds(bag)
    assert 30 * share - 4 < whole <= 30 * share + 1
    world = BagWorld(tmp_path)
    (note,) = world.notes
    assert source.name in note
    assert "is cut off" in note
    assert world.frame_count == pytest.approx(whole, abs=1)
    last = world.scan("R1", world.frame_count - 1)
    assert np.array_equal(last.points, POINTS)


@pytest.mark.parametrize("suffix", STORAGES.values())
@pytest.mark.parametrize("share", [0.001, 0.0])
def test_a_bag_cut_off_at_its_beginning_is_named(
    written: Path, tmp_path: Path, suffix: str, share: float
) -> None:
    (source,) = written.glob(f"*/*{suffix}")
    raw = source.read_bytes()
    (tmp_path / f"R1{suffix}").write_bytes(raw[: int(len(raw) * share)])
    with pytest.raises(WorldError, match=f"R1{suffix}"):
        BagWorld(tmp_path)


def test_what_a_recorder_had_only_in_its_journal_is_read(written: Path, tmp_path: Path) -> None:
    source = sqlite3.connect(written / "sqlite3" / "sqlite3.db3")
    running = sqlite3.connect(tmp_path / "running.db3")
    running.execute("PRAGMA journal_mode=WAL")
    source.backup(running)
    source.close()
    folder = tmp_path / "bags"
    folder.mkdir()
    for ending in ("", "-wal"):  # As a power failure leaves them: the writer never closed.
        shutil.copy(tmp_path / f"running.db3{ending}", folder / f"R1.db3{ending}")
    running.close()
    assert clouds(folder / "R1.db3") == 30


def test_a_journal_that_cannot_be_read_is_named_and_an_empty_one_left_aside(
    written: Path, tmp_path: Path
) -> None:
    shutil.copy(written / "sqlite3" / "sqlite3.db3", tmp_path / "R1.db3")
    journaled = sqlite3.connect(tmp_path / "R1.db3")
    journaled.execute("PRAGMA journal_mode=WAL")
    journaled.close()
    # As in a folder that cannot be written: SQLite cannot make the file it needs for a journal.
    (tmp_path / "R1.db3-shm").symlink_to(tmp_path / "nowhere" / "else")
    (tmp_path / "R1.db3-wal").touch()
    assert clouds(tmp_path / "R1.db3") == 30
    (tmp_path / "R1.db3-wal").write_bytes(bytes(32))
    with pytest.raises(WorldError, match=r"journal beside it .-wal. can only be read in a folder"):
        clouds(tmp_path / "R1.db3")


def test_a_damaged_chunk_is_named_when_it_is_read(tmp_path: Path) -> None:
    Log().scans(TIMES, POINTS).drive(TIMES, child="lidar").write(tmp_path / "R1", "mcap", "storage")
    file = tmp_path / "R1" / "R1.mcap"
    magic_of_zstd = bytes.fromhex("28b52ffd")
    file.write_bytes(file.read_bytes().replace(magic_of_zstd, bytes(4)))
    with pytest.raises(WorldError, match=r"the chunk at byte \d+ of bag file .*R1.mcap is damaged"):
        clouds(tmp_path / "R1")


@pytest.mark.parametrize("damage", [b"\xff" * 8, b"\0" * 7 + b"\x80", b"\xff" * 3])
@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4, "chunk_size": 300},
        None,
    ],
)
def test_a_bag_damaged_anywhere_is_read_or_refused(
    tmp_path: Path, options: dict[str, object] | None, damage: bytes
) -> None:
    """Lengths, times and places that no file can have: None is rosbag2's own sqlite3 storage."""
    bag = plain_log([0.0, 0.1]).write(tmp_path / "source", "mcap" if options else "sqlite3")
    folder = tmp_path / "bags"
    folder.mkdir()
    if options:
        path = write_mcap(Recording(bag), folder / "R1.mcap", options)
        places = range(8, path.stat().st_size, 5)
    else:
        path = Path(shutil.copy(bag / "source.db3", folder / "R1.db3"))
        places = range(16, path.stat().st_size, 97)
    raw = path.read_bytes()
    refused = 0
    for at in places:
        path.write_bytes(raw[:at] + damage + raw[at + len(damage) :])
        try:
            world = BagWorld(folder)
            world.scan("R1", 0)
            world.scan("R1", 1)
        except WorldError:
            refused += 1
    assert 0 < refused < len(places)


def test_a_packed_message_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    bag = plain_log(TIMES).write(tmp_path / "R1", "mcap", "message")
    source = Recording(bag)
    claims = bytes.fromhex("28b52ffd e0 000000000000 0010 010000")  # 2^60 bytes, in an empty block
    with (tmp_path / "big.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="", library="test")
        for topic, kind in source.topics.items():
            schema = writer.register_schema(kind, "ros2msg", b"")
            writer.add_message(writer.register_channel(topic, "cdr", schema), 1, claims, 1)
        writer.finish()
    shutil.move(tmp_path / "big.mcap", bag / "R1.mcap")
    with pytest.raises(
        WorldError, match=r"message 0 of topic /points of bag .*R1 is malformed: it unpacks to"
    ):
        BagWorld(tmp_path)


def test_a_chunk_of_another_compression_is_named(tmp_path: Path) -> None:
    source = Recording(plain_log(TIMES).write(tmp_path / "source"))
    folder = tmp_path / "bags"
    folder.mkdir()
    options = {"compression": CompressionType.LZ4, "enable_crcs": False}
    path = write_mcap(source, folder / "R1.mcap", options)
    path.write_bytes(path.read_bytes().replace(b"\3\0\0\0lz4", b"\3\0\0\0xyz"))
    with pytest.raises(WorldError, match="compressed with 'xyz'; allowed: lz4, zstd and none"):
        BagWorld(folder)


def test_files_that_are_no_bags_are_named(tmp_path: Path) -> None:
    (tmp_path / "R1.mcap").write_bytes(b"something else" * 100)
    with pytest.raises(WorldError, match=r"R1.mcap is not an MCAP file"):
        BagWorld(tmp_path)
    (tmp_path / "R1.mcap").rename(tmp_path / "R1.db3")
    with pytest.raises(WorldError, match=r"R1.db3 cannot be read: file is not a database"):
        BagWorld(tmp_path)
    (tmp_path / "R1.db3").unlink()
    sqlite3.connect(tmp_path / "R1.db3").execute("CREATE TABLE t(a)").connection.close()
    with pytest.raises(WorldError, match=r"R1.db3 cannot be read: no such table: topics"):
        BagWorld(tmp_path)


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ("a: [", "metadata.yaml cannot be read"),
        ("a: 1", "metadata.yaml cannot be read"),
        (
            "rosbag2_bagfile_information: {relative_file_paths: [x.mcap]}",
            "names x.mcap, which is n",
        ),
        (
            "rosbag2_bagfile_information: {relative_file_paths: [], compression_mode: MESSAGE, "
            "compression_format: lzma}",
            "compressed with 'lzma'; allowed: zstd",
        ),
    ],
)
def test_wrong_metadata_is_named(written: Path, tmp_path: Path, metadata: str, words: str) -> None:
    shutil.copytree(written / "mcap", tmp_path / "R1")
    (tmp_path / "R1" / "metadata.yaml").write_text(metadata)
    with pytest.raises(WorldError, match=words):
        BagWorld(tmp_path)


def test_a_folder_must_hold_bags_one_a_robot(written: Path, tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="holds no bags"):
        BagWorld(tmp_path)
    with pytest.raises(WorldError, match="cannot be read"):
        BagWorld(tmp_path / "nowhere")
    with pytest.raises(WorldError, match="is itself a bag"):
        BagWorld(written / "mcap")
    (tmp_path / "notes.txt").touch()
    (tmp_path / ".hidden.mcap").touch()
    (tmp_path / "pictures").mkdir()
    (tmp_path / "R1.mcap").touch()
    assert list(find_bags(tmp_path)) == ["R1"]
    (tmp_path / "R1.db3").touch()
    with pytest.raises(WorldError, match="both bags of robot 'R1'"):
        find_bags(tmp_path)
    (tmp_path / "R1.db3").rename(tmp_path / "R2.bag")
    with pytest.raises(WorldError, match=r"R2.bag is a bag of ROS 1; convert it"):
        find_bags(tmp_path)


def test_a_folder_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = tmp_path / "lost+found"
    locked.mkdir()
    listed = Path.iterdir

    def refused(folder: Path) -> Iterator[Path]:
        # As for anybody but root, whom no mode keeps out.
        if folder == locked:
            raise PermissionError(13, "Permission denied")
        return listed(folder)

    monkeypatch.setattr(Path, "iterdir", refused)
    with pytest.raises(WorldError, match=r"lost\+found cannot be read: .*Permission denied"):
        find_bags(tmp_path)


@pytest.mark.parametrize("name", ["R1", "a_b-9", "x" * 32, "x" * 33, "R 1", "a.b", "ä", "R1\n"])
def test_robots_are_called_what_a_key_allows(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.mcap").touch()
    try:
        check_name("robot id", name)
    except KeyspaceError:
        with pytest.raises(WorldError, match="names a robot"):
            find_bags(tmp_path)
    else:
        assert list(find_bags(tmp_path)) == [name]
