"""`coadapt why` on a journal file."""

from __future__ import annotations

import json
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from coadapt.main import main
from ego_agent.knowledge.journal import Journal
from ego_agent.knowledge.why import explain, find
from tests.support.why_journals import journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    written = Journal(tmp_path / "journal.jsonl")
    for record in journal(random.Random(9), 6):
        written.commit(record)
    written.close()
    return tmp_path / "journal.jsonl"


def expected(cycle: int | None = None) -> str:
    return explain(find(journal(random.Random(9), 6), cycle)).text()


def test_it_explains_the_newest_decision_of_a_journal(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["why", "--journal", str(path)]) == 0
    assert capsys.readouterr().out.strip() == expected()


def test_it_explains_another_cycle_as_json(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["why", "--journal", str(path), "--cycle", "3", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["ego"], report["cycle"]) == ("R1", 3)
    groups = ("decision", "robots", "changed", "limits", "otherwise", "lacks")
    assert "\n".join(sentence for name in groups for sentence in report[name]) == expected(3)


def test_a_cycle_that_is_not_there_and_a_file_that_is_not_there_are_named(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["why", "--journal", str(path), "--cycle", "77"]) == 1
    assert "no cycle 77; allowed: 1 to 6" in capsys.readouterr().err
    assert main(["why", "--journal", str(path.with_name("none.jsonl"))]) == 1
    assert "none.jsonl" in capsys.readouterr().err


@contextmanager
def server(says: str) -> Iterator[str]:
    """An OpenAI-compatible server that always says the same."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            body = json.dumps({"choices": [{"message": {"content": says}}]}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    endpoint = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=endpoint.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{endpoint.server_address[1]}"
    finally:
        endpoint.shutdown()
        thread.join()
        endpoint.server_close()


def test_words_of_a_model_are_shown_where_they_are_true(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "In cycle 6 the ego went on as the facts say."
    with server(words) as url:
        assert main(["why", "--journal", str(path), "--phrase", url]) == 0
    assert capsys.readouterr().out.strip() == words


@pytest.mark.parametrize("lie", ["R77 helps in cycle 6.", "It costs 987.6 kB."])
def test_words_of_a_model_are_dropped_where_they_name_what_the_facts_do_not(
    path: Path, capsys: pytest.CaptureFixture[str], lie: str
) -> None:
    with server(lie) as url:
        assert main(["why", "--journal", str(path), "--phrase", url]) == 0
    said = capsys.readouterr()
    assert said.out.strip() == expected()
    assert "dropped: the facts" in said.err


def test_without_a_model_the_codes_own_words_are_shown(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with server("") as url:
        pass
    assert main(["why", "--journal", str(path), "--phrase", url]) == 0
    said = capsys.readouterr()
    assert said.out.strip() == expected()
    assert "no words of a model" in said.err
