"""Events reach a real sink as CloudEvents, and a sink that misbehaves stops nobody."""

from __future__ import annotations

import shutil
import socket
import ssl
import subprocess
from collections.abc import Generator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry

from network_controller.qod import events
from network_controller.qod.destinations import Destinations
from network_controller.qod.events import Notifier
from network_controller.qod.messages import StatusChange, StatusEvent
from network_controller.qod.metrics import QodMetrics
from network_controller.qod.sinks import Sink as Address
from tests.support.qod_client import LOG, LOOPBACK, SESSIONS, Api, Sink, device, listening, served
from tests.support.zenoh_fixtures import until

TYPE = "org.camaraproject.quality-on-demand.v1.qos-status-changed"
EVENTS = "coadapt_qod_events_total"


@pytest.fixture
def sink() -> Generator[Sink]:
    with listening() as sink:
        yield sink


@pytest.fixture
def api(sink: Sink) -> Generator[Api]:
    with served(sinks=LOOPBACK) as api:
        yield api


def counted(api: Api, outcome: str, count: int = 1) -> None:
    until(lambda: api.count(EVENTS, outcome=outcome) == count, f"{count} events {outcome}")


def test_a_session_tells_of_its_begin_and_its_end(api: Api, sink: Sink) -> None:
    session = api.create(sink=sink.url).body
    begin = sink.next()
    assert begin.path == "/events?of=qod"
    assert begin.headers["content-type"] == "application/cloudevents+json"
    assert "authorization" not in begin.headers
    event = begin.event
    assert (event["specversion"], event["type"]) == ("1.0", TYPE)
    assert event["datacontenttype"] == "application/json"
    assert event["source"] == f"{SESSIONS}/{session['sessionId']}"
    assert datetime.fromisoformat(event["time"]) <= datetime.now(UTC)
    assert event["data"] == {"sessionId": session["sessionId"], "qosStatus": "AVAILABLE"}
    api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
    end = sink.next().event
    assert end["id"] != event["id"]
    assert end["data"] == {
        "sessionId": session["sessionId"],
        "qosStatus": "UNAVAILABLE",
        "statusInfo": "DELETE_REQUESTED",
    }
    counted(api, "delivered", 2)


def test_the_end_of_the_time_and_of_the_link_are_told_with_their_reason(
    api: Api, sink: Sink
) -> None:
    api.create(sink=sink.url, duration=1)
    api.create(sink=sink.url, device=device("10.77.0.3"))
    api.server.lost("R2")
    told = [sink.next().event["data"] for _ in range(4)]
    reasons = sorted(one.get("statusInfo", "") for one in told)
    assert reasons == ["", "", "DURATION_EXPIRED", "NETWORK_TERMINATED"]


def test_deleting_what_the_network_ended_is_not_told_again(api: Api, sink: Sink) -> None:
    session = api.create(sink=sink.url).body
    api.server.lost("R1")
    api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
    api.create(sink=sink.url)
    told = [sink.next().event["data"] for _ in range(3)]
    assert [one.get("statusInfo") for one in told] == [None, "NETWORK_TERMINATED", None]


def test_what_the_kernel_refuses_is_told(api: Api, sink: Sink) -> None:
    api.links.broken = "tc: no such device"
    api.create(sink=sink.url)
    assert sink.next().event["data"]["statusInfo"] == "NETWORK_TERMINATED"


def test_the_sink_is_shown_its_token_and_nobody_else_is(api: Api, sink: Sink) -> None:
    credential = {
        "credentialType": "ACCESSTOKEN",
        "accessToken": "for-the-sink",
        "accessTokenExpiresUtc": (datetime.now(UTC) + timedelta(hours=1)).isoformat(),
        "accessTokenType": "bearer",
    }
    reply = api.create(sink=sink.url, sinkCredential=credential)
    assert sink.next().headers["authorization"] == "Bearer for-the-sink"
    assert "sinkCredential" not in reply.body
    assert "for-the-sink" not in str(api.send("GET", f"{SESSIONS}/{reply.body['sessionId']}"))


def test_a_sink_that_fails_is_asked_again(
    api: Api, sink: Sink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "PAUSE_S", 0.01)
    sink.statuses = [503, 429]
    api.create(sink=sink.url)
    ids = {sink.next().event["id"] for _ in range(3)}
    assert len(ids) == 1
    counted(api, "delivered")


@pytest.mark.parametrize("status", [302, 401, 410])
def test_a_sink_that_refuses_or_redirects_is_not_asked_again(
    api: Api, sink: Sink, status: int
) -> None:
    sink.statuses = [status]
    session = api.create(sink=sink.url).body
    counted(api, "refused")
    api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
    assert sink.next().event["data"]["qosStatus"] == "AVAILABLE"
    assert sink.next().event["data"]["qosStatus"] == "UNAVAILABLE"


def test_a_sink_that_hangs_does_not_keep_the_api_waiting(api: Api, sink: Sink) -> None:
    sink.hold.clear()
    session = api.create(sink=sink.url).body
    sink.next()
    assert api.send("DELETE", f"{SESSIONS}/{session['sessionId']}").status == 204
    assert api.create().status == 201
    sink.hold.set()
    while sink.next().event["data"]["qosStatus"] != "UNAVAILABLE":
        pass


def test_a_sink_that_is_not_there_is_given_up(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "PAUSE_S", 0.01)
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        assert api.create(sink=f"http://127.0.0.1:{taken.getsockname()[1]}/").status == 201
        counted(api, "failed")


def drip(connection: socket.socket) -> None:
    """Sends a byte more often than any timeout of a socket, until the other side ends it."""
    connection.settimeout(0.05)
    while True:
        try:
            connection.sendall(b"H")
            if not connection.recv(4096):
                return
        except TimeoutError:
            continue
        except OSError:
            return


def test_a_sink_that_drips_is_cut_off(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "ATTEMPTS", 1)
    monkeypatch.setattr(events, "TIMEOUT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        api.create(sink=f"http://127.0.0.1:{server.getsockname()[1]}/")
        connection, _ = server.accept()
        with connection:
            drip(connection)
        counted(api, "failed")


def test_closing_the_api_tells_the_sinks(sink: Sink) -> None:
    with served(sinks=LOOPBACK) as api:
        api.create(sink=sink.url)
        assert sink.next().event["data"]["qosStatus"] == "AVAILABLE"
    assert sink.next().event["data"]["statusInfo"] == "NETWORK_TERMINATED"


def posted(number: int) -> StatusEvent:
    change = StatusChange(session_id=str(number), qos_status="AVAILABLE")
    return StatusEvent(id=str(number), source="/test", time=datetime.now(UTC), data=change)


def test_events_for_one_sink_keep_their_order_and_too_many_are_dropped(sink: Sink) -> None:
    registry = CollectorRegistry()
    notifier = Notifier(Destinations(LOOPBACK), QodMetrics(registry), LOG)
    address = Address(False, "127.0.0.1", sink.server.server_port, "/", None, None)
    for number in range(events.WAITING + 5):
        notifier.post(address, posted(number))
    assert registry.get_sample_value(EVENTS, {"outcome": "dropped"}) == 5
    notifier.start()
    assert [sink.next().event["id"] for _ in range(20)] == [str(number) for number in range(20)]
    notifier.close()


def test_nothing_is_sent_after_the_token_has_expired(sink: Sink) -> None:
    registry = CollectorRegistry()
    notifier = Notifier(Destinations(LOOPBACK), QodMetrics(registry), LOG)
    notifier.start()
    over = datetime.now(UTC) - timedelta(seconds=1)
    port = sink.server.server_port
    notifier.post(Address(False, "127.0.0.1", port, "/", "token", over), posted(1))
    notifier.post(Address(False, "127.0.0.1", port, "/", None, None), posted(2))
    assert sink.next().event["id"] == "2"
    assert registry.get_sample_value(EVENTS, {"outcome": "expired"}) == 1
    notifier.close()


def test_over_https_the_sink_must_show_a_certificate_that_is_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("no openssl to make a certificate with")
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    command = (
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 "
        f"-subj /CN=sink -addext subjectAltName=IP:127.0.0.1 -keyout {key} -out {certificate}"
    )
    subprocess.run(command.split(), check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    monkeypatch.setattr(events, "ATTEMPTS", 1)
    with listening(context) as sink, served(sinks=LOOPBACK) as api:
        session = api.create(sink=sink.url).body
        counted(api, "failed")
        assert sink.received.empty()
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
        assert sink.next().event["data"]["statusInfo"] == "DELETE_REQUESTED"
