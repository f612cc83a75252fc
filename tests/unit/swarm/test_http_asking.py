"""One question to an HTTP server: what is sent, what comes back, and what goes wrong."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from swarm.errors import TransportError
from swarm.http.asking import ask
from tests.support.free_ports import free_port

SOON_S = 5.0


class Echo(BaseHTTPRequestHandler):
    """Says what it was asked; `/elsewhere` leads to another server."""

    def do_GET(self) -> None:
        self._answer(b"")

    def do_POST(self) -> None:
        self._answer(self.rfile.read(int(self.headers["Content-Length"])))

    def _answer(self, body: bytes) -> None:
        said = f"{self.command} {self.path} {self.headers['X-Key']} ".encode() + body
        if self.path == "/elsewhere":
            self.send_response(302)
            self.send_header("Location", "http://127.0.0.1:9/")
        else:
            self.send_response(200 if self.path.startswith("/there") else 404)
        self.send_header("Content-Length", str(len(said)))
        self.end_headers()
        self.wfile.write(said)

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def serving() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Echo)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture(scope="module")
def echo() -> Iterator[str]:
    with serving() as url:
        yield url


def test_query_headers_and_body_arrive(echo: str) -> None:
    asked = ask(f"{echo}/there?a=1", headers={"X-Key": "k"}, timeout_s=SOON_S, most_bytes=100)
    assert asked == (200, b"GET /there?a=1 k ")
    asked = ask(f"{echo}/there", body=b"words", timeout_s=SOON_S, most_bytes=100)
    assert asked == (200, b"POST /there None words")


def test_a_refusal_is_an_answer_and_no_redirect_is_followed(echo: str) -> None:
    assert ask(f"{echo}/no", timeout_s=SOON_S, most_bytes=100)[0] == 404
    assert ask(f"{echo}/elsewhere", timeout_s=SOON_S, most_bytes=100)[0] == 302


def test_no_more_is_read_than_wanted(echo: str) -> None:
    assert ask(f"{echo}/there", timeout_s=SOON_S, most_bytes=3) == (200, b"GET")


def test_no_proxy_of_the_environment_is_asked(echo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{free_port()}")
    assert ask(f"{echo}/there", timeout_s=SOON_S, most_bytes=100)[0] == 200


@pytest.mark.parametrize(
    "url", ["", "127.0.0.1:80", "ftp://127.0.0.1/", "http://", "http://[::1", "http://a:99999/"]
)
def test_what_is_no_url_of_a_server_is_said(url: str) -> None:
    with pytest.raises(TransportError):
        ask(url, timeout_s=SOON_S, most_bytes=100)


def test_a_server_that_is_not_there_is_said() -> None:
    with pytest.raises(TransportError, match="refused"):
        ask(f"http://127.0.0.1:{free_port()}/", timeout_s=SOON_S, most_bytes=100)
