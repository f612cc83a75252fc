"""The cache: found again after a restart, forgotten in time, and memory when the disk fails."""

from __future__ import annotations

import asyncio
import os
import sqlite3
import subprocess
import sys
from collections.abc import Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from llm_gateway.cache import Cache
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Prompt
from swarm.log import make_logger
from swarm.messages import LlmTokens
from tests.support.llm_scripted import EARLY, LONG_S, Scripted, job, rig
from tests.support.paths import REPOSITORY

TOKENS = LlmTokens(prompt=7, reused=3, output=2)


class Kept:
    """A cache with a clock that a test moves."""

    def __init__(self, path: Path | None, **options: Any) -> None:
        self.now = 1_000_000.0
        self.registry = CollectorRegistry()
        self.cache = Cache(
            path,
            GatewayMetrics(self.registry),
            make_logger("test", level="error"),
            clock=lambda: self.now,
            **options,
        )

    async def __aenter__(self) -> Kept:
        await self.cache.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.cache.close()

    def put(self, key: str, scene: str = "", text: str = EARLY) -> None:
        self.cache.put(key, scene, "m", text, TOKENS)

    def get(self, key: str, scene: str = "") -> str | None:
        found = self.cache.exact(key) or self.cache.similar(scene)
        return found.text if found else None

    async def written(self) -> None:
        """Until the disk has what was put."""
        while self.cache._writes:
            await asyncio.sleep(0.001)

    def faults(self, kind: str) -> float:
        name = "coadapt_llm_cache_faults_total"
        return self.registry.get_sample_value(name, {"kind": kind}) or 0.0


def run(work: Coroutine[Any, Any, None]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(LONG_S):
            await work

    asyncio.run(bounded())


def test_answers_survive_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "made" / "cache.db"

    async def scenario() -> None:
        async with Kept(path) as kept:
            kept.put("k1", "s1")
            kept.now += 1
            kept.put("k2", "s1", text="newer")
        async with Kept(path) as kept:
            kept.now += 100
            assert kept.get("none", "s1") == "newer"
            assert kept.get("k1") == EARLY
            assert kept.get("none", "s2") is None
            entry = kept.cache.exact("k1")
            assert entry is not None
            assert (entry.tokens, entry.model, kept.cache.age_s(entry)) == (TOKENS, "m", 100)

    run(scenario())


@pytest.mark.parametrize("on_disk", [False, True])
def test_answers_are_forgotten_in_time(tmp_path: Path, on_disk: bool) -> None:
    async def scenario() -> None:
        async with Kept(tmp_path / "c.db" if on_disk else None, ttl_s=60) as kept:
            kept.put("k1", "s1")
            kept.now += 60
            assert kept.get("k1") == kept.get("", "s1") == EARLY
            kept.now += 1
            assert kept.get("k1") is None
            assert kept.get("", "s1") is None
            # As after the clock was set back.
            kept.now -= 200
            assert kept.get("k1") is None

    run(scenario())


def test_the_oldest_answers_make_room_on_disk_and_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "cache.db"

    async def scenario() -> None:
        async with Kept(path, entries=5) as kept:
            for i in range(12):
                kept.now += 1
                kept.put(f"k{i}")
                assert len(kept.cache._memory) <= 5
            assert kept.get("k6") is None
            assert kept.get("k7") == EARLY
        async with Kept(path, entries=5) as kept:
            kept.now += 12
            found = [i for i in range(12) if kept.get(f"k{i}")]
            assert found == [7, 8, 9, 10, 11]

    run(scenario())


def test_what_was_used_last_stays_in_memory() -> None:
    async def scenario() -> None:
        async with Kept(None, entries=2) as kept:
            kept.put("a")
            kept.put("b")
            assert kept.get("a")
            kept.put("c")
            assert kept.get("a")
            assert kept.get("b") is None

    run(scenario())


def test_an_answer_is_found_by_its_present_scene_only() -> None:
    async def scenario() -> None:
        async with Kept(None) as kept:
            kept.put("k1", "s1")
            kept.put("k1", "s2")
            assert kept.get("", "s1") is None
            assert kept.get("", "s2") == EARLY

    run(scenario())


def test_very_long_answers_are_not_kept() -> None:
    async def scenario() -> None:
        async with Kept(None) as kept:
            kept.put("k1", text="x" * 20_001)
            assert kept.get("k1") is None

    run(scenario())


def damage_beginning(path: Path) -> None:
    path.write_bytes(b"no database at all" * 100)


def damage_middle(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(data)


@pytest.mark.parametrize("damage", [damage_beginning, damage_middle])
def test_a_corrupt_file_is_moved_aside(tmp_path: Path, damage: Any) -> None:
    path = tmp_path / "cache.db"

    async def scenario() -> None:
        async with Kept(path) as kept:
            for i in range(50):
                kept.put(f"k{i}", text=EARLY * 20)
        damage(path)
        async with Kept(path) as kept:
            assert kept.faults("corrupt") == 1
            assert (tmp_path / "cache.db.corrupt").exists()
            assert kept.get("k1") is None
            kept.put("new")
        async with Kept(path) as kept:
            assert kept.get("new") == EARLY
            assert kept.faults("corrupt") == 0

    run(scenario())


def test_a_file_that_is_corrupted_while_it_is_used_is_moved_aside(tmp_path: Path) -> None:
    path = tmp_path / "cache.db"

    async def scenario() -> None:
        async with Kept(path) as kept:
            for i in range(200):
                kept.put(f"k{i:03}", text=EARLY * 50)
            await kept.written()
            with sqlite3.connect(path) as other:
                other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            other.close()
            damage_middle(path)
            for i in range(200):
                kept.put(f"n{i:03}")
            await kept.written()
            assert kept.faults("corrupt") == 1
            assert kept.get("k001") == EARLY * 50
        async with Kept(path) as kept:
            assert kept.get("n199") == EARLY

    run(scenario())


def test_rows_that_make_no_sense_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "cache.db"

    async def scenario() -> None:
        async with Kept(path) as kept:
            kept.put("k1")
            kept.put("k2")
        with sqlite3.connect(path) as other:
            other.execute("UPDATE answers_1 SET text = x'ff00', made_at = 'then' WHERE key = 'k1'")
        other.close()
        async with Kept(path) as kept:
            assert kept.get("k1") is None
            assert kept.get("k2") == EARLY

    run(scenario())


def test_an_answer_on_disk_that_does_not_follow_its_schema_is_not_given(tmp_path: Path) -> None:
    path = tmp_path / "cache.db"

    async def script(prompt: Prompt, timeout_s: float) -> str:
        return EARLY

    async def scenario() -> None:
        async with rig(Scripted(script), path) as made:
            await made.gateway.complete(job())
        async with rig(Scripted(script), path) as made:
            assert (await made.gateway.complete(job())).hit == "exact"
        with sqlite3.connect(path) as other:
            other.execute("""UPDATE answers_1 SET text = '{"algorithm":"none"}'""")
        other.close()
        async with rig(Scripted(script), path) as made:
            assert (await made.gateway.complete(job())).source == "llm"

    run(scenario())


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system that is full after a few answers."""
    place = tmp_path / "tiny"
    place.mkdir()
    mounted = os.geteuid() == 0 and (
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)], capture_output=True
        ).returncode
        == 0
    )
    if not mounted:
        pytest.skip("needs root: a file system of its own is filled")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_a_full_disk_is_counted_and_memory_goes_on(tiny_disk: Path) -> None:
    async def scenario() -> None:
        async with Kept(tiny_disk / "cache.db") as kept:
            for i in range(100):
                kept.put(f"k{i}", text=f"{i} " * 2_000)
                await kept.written()
            assert kept.faults("write") > 0
            assert kept.faults("corrupt") == 0
            assert kept.get("k99") == "99 " * 2_000

    run(scenario())


def test_files_that_may_not_grow_are_counted_and_memory_goes_on(tmp_path: Path) -> None:
    # In a process of its own: the limit holds for all files.
    code = (
        "import asyncio, resource, sys\n"
        "from pathlib import Path\n"
        "from tests.unit.llm_gateway.test_cache import Kept\n"
        "async def scenario():\n"
        "    async with Kept(Path(sys.argv[1])) as kept:\n"
        "        resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))\n"
        "        for i in range(60):\n"
        "            kept.put(f'k{i}', text=f'{i} ' * 2_000)\n"
        "            await kept.written()\n"
        "        assert kept.faults('write') > 0\n"
        "        assert kept.get('k59') == '59 ' * 2_000\n"
        "asyncio.run(scenario())\n"
        "print('went on')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "cache.db")],
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
        timeout=60,
    )
    assert done.stdout == "went on\n", done.stderr


def test_a_directory_that_cannot_be_made_leaves_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    async def scenario() -> None:
        async with Kept(tmp_path / "file" / "cache.db") as kept:
            kept.put("k1")
            assert kept.get("k1") == EARLY
            await kept.written()
            assert (kept.faults("read"), kept.faults("write")) == (1, 1)

    run(scenario())
