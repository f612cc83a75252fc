"""What the API refuses, in CAMARA's words; the token, the correlator and the document."""

from __future__ import annotations

import http.client
import json
import socket
import stat
import uuid
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from network_controller import ladder
from network_controller.qod.profiles import LEVELS
from network_controller.qod.server import Server
from swarm.errors import NetworkError, SettingError
from swarm.traffic import TrafficClass
from tests.support.paths import REPOSITORY
from tests.support.qod_client import (
    LOG,
    PROFILES,
    RETRIEVE,
    RETRIEVE_PROFILES,
    SESSIONS,
    Api,
    Links,
    Reply,
    device,
    served,
    wish,
)

CREDENTIAL = {
    "credentialType": "ACCESSTOKEN",
    "accessToken": "opaque",
    "accessTokenExpiresUtc": "2999-01-01T00:00:00Z",
    "accessTokenType": "bearer",
}
SINK = "https://example.com/events"
NO_SESSION = f"{SESSIONS}/{uuid.UUID(int=1)}"


@pytest.fixture(scope="module")
def api() -> Generator[Api]:
    with served() as api:
        yield api


def refused(reply: Reply, status: int, code: str) -> str:
    """The message of an answer that must be a refusal."""
    assert (reply.status, reply.body["status"], reply.body["code"]) == (status, status, code)
    assert reply.headers["content-type"] == "application/json"
    assert set(reply.body) == {"status", "code", "message"}
    return str(reply.body["message"])


@pytest.mark.parametrize(
    "changes",
    [
        {"applicationServer": None},
        {"qosProfile": None},
        {"duration": None},
        {"duration": 0},
        {"duration": 2**31},
        {"duration": "60"},
        {"device": {}},
        {"device": {"ipv4Address": {"publicAddress": "10.77.0.2"}}},
        {"device": {"ipv4Address": {"publicAddress": "10.77.0", "publicPort": 1}}},
        {"device": {"ipv4Address": {"publicAddress": "10.77.0.2", "publicPort": 65536}}},
        {"device": {"phoneNumber": "123"}},
        {"device": {"ipv6Address": "::g"}},
        {"applicationServer": {}},
        {"applicationServer": {"ipv4Address": "10.77.0.1/33"}},
        {"applicationServer": {"ipv4Address": "10.77.0.1\n"}},
        {"applicationServer": {"ipv6Address": "10.77.0.1"}},
        {"devicePorts": {}},
        {"devicePorts": {"ports": []}},
        {"devicePorts": {"ports": [-1]}},
        {"applicationServerPorts": {"ranges": [{"from": 2, "to": 1}]}},
        {"qosProfile": "QOS_XXL"},
        {"sinkCredential": {}},
        {"sinkCredential": {"credentialType": "ACCESSTOKEN"}},
    ],
)
def test_a_body_of_the_wrong_form_is_an_invalid_argument(api: Api, changes: Any) -> None:
    refused(api.create(**changes), 400, "INVALID_ARGUMENT")
    assert api.links.holds == {}


def test_the_message_names_the_field_and_what_is_allowed(api: Api) -> None:
    message = refused(api.create(devicePorts={"ports": [70000]}), 400, "INVALID_ARGUMENT")
    assert "65535" in message
    assert "devicePorts.ports" in message


@pytest.mark.parametrize("raw", [b"", b"{", b"[]", b"null", b"\xff", b'"x"', b"[" * 60_000])
@pytest.mark.parametrize("path", [SESSIONS, f"{NO_SESSION}/extend", RETRIEVE, RETRIEVE_PROFILES])
def test_what_is_no_json_object_is_an_invalid_argument(api: Api, path: str, raw: bytes) -> None:
    refused(api.send("POST", path, raw=raw), 400, "INVALID_ARGUMENT")


def test_a_body_that_is_too_long_is_not_read_to_its_end(api: Api) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", api.server.port, timeout=10)) as to:
        to.putrequest("POST", SESSIONS)
        to.putheader("Content-Type", "application/json")
        to.putheader("Content-Length", str(10**9))
        to.endheaders(b" " * 100_000)
        response = to.getresponse()
        assert response.status == 400
        assert json.loads(response.read())["code"] == "INVALID_ARGUMENT"


def test_a_body_must_be_declared_as_json(api: Api) -> None:
    raw = json.dumps(wish()).encode()
    reply = api.send("POST", SESSIONS, raw=raw, headers={"Content-Type": "text/plain"})
    refused(reply, 415, "UNSUPPORTED_MEDIA_TYPE")


def test_a_duration_beyond_the_profile_is_out_of_range(api: Api) -> None:
    message = refused(api.create(duration=86_401), 400, "QUALITY_ON_DEMAND.DURATION_OUT_OF_RANGE")
    assert "86401" in message
    assert "86400" in message


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"sink": "http://example.com/events"}, "INVALID_SINK"),
        ({"sink": "ftp://example.com/events"}, "INVALID_SINK"),
        ({"sink": "https://"}, "INVALID_SINK"),
        ({"sink": "https://user:password@example.com/"}, "INVALID_SINK"),
        ({"sink": "https://example.com/a b"}, "INVALID_SINK"),
        ({"sink": "https://example.com:99999/"}, "INVALID_SINK"),
        ({"sink": "https://[::1/"}, "INVALID_SINK"),
        ({"sinkCredential": {"credentialType": "PLAIN"}}, "INVALID_CREDENTIAL"),
        ({"sinkCredential": {"credentialType": "REFRESHTOKEN"}}, "INVALID_CREDENTIAL"),
        ({"sinkCredential": CREDENTIAL | {"accessTokenType": "mac"}}, "INVALID_TOKEN"),
        ({"sinkCredential": CREDENTIAL | {"accessToken": "a\r\nX: b"}}, "INVALID_TOKEN"),
        (
            {"sinkCredential": CREDENTIAL | {"accessTokenExpiresUtc": "2001-01-01T00:00:00Z"}},
            "INVALID_TOKEN",
        ),
    ],
)
def test_a_sink_that_cannot_be_used_is_refused(api: Api, changes: Any, code: str) -> None:
    refused(api.create(**({"sink": SINK} | changes)), 400, code)


@pytest.mark.parametrize("path", [SESSIONS, RETRIEVE])
def test_devices_are_known_by_their_ipv4_address_only(api: Api, path: str) -> None:
    def ask(device: Any) -> Reply:
        body = wish(device=device) if path == SESSIONS else {"device": device} if device else {}
        return api.send("POST", path, body)

    refused(ask(None), 422, "MISSING_IDENTIFIER")
    refused(ask({"phoneNumber": "+123456789"}), 422, "UNSUPPORTED_IDENTIFIER")
    refused(ask({"ipv6Address": "2001:db8::1"}), 422, "UNSUPPORTED_IDENTIFIER")
    refused(ask({"networkAccessIdentifier": "a@b.c"}), 422, "UNSUPPORTED_IDENTIFIER")
    refused(ask(device("10.99.0.1")), 404, "IDENTIFIER_NOT_FOUND")


def test_of_several_identifiers_the_one_that_counts_is_told(api: Api) -> None:
    session = api.create(device=device("10.77.0.2") | {"phoneNumber": "+123456789"}).body
    assert session["device"] == device("10.77.0.2")
    api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")


def test_nothing_is_promised_on_a_link_that_is_not_shaped(api: Api) -> None:
    message = refused(api.create(device=device("10.77.0.4")), 422, "SERVICE_NOT_APPLICABLE")
    assert "R3" in message


def test_a_network_that_cannot_be_asked_is_told() -> None:
    class Broken(Links):
        def robot_at(self, ipv4: str) -> str | None:
            raise NetworkError("no Docker here")

    with served(Broken()) as api:
        assert refused(api.create(), 503, "UNAVAILABLE") == "no Docker here"


def test_a_failure_inside_is_a_500_and_the_api_goes_on() -> None:
    class Broken(Links):
        def robot_at(self, ipv4: str) -> str | None:
            raise RuntimeError("secret detail")

    with served(Broken()) as api:
        assert "secret" not in refused(api.create(), 500, "INTERNAL")
        assert api.send("GET", "/health").body == {"status": "ok"}
        assert api.count("coadapt_qod_requests_total", method="POST", status="5xx") == 1


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", NO_SESSION, 404, "NOT_FOUND"),
        ("DELETE", NO_SESSION, 404, "NOT_FOUND"),
        ("GET", f"{SESSIONS}/42", 400, "INVALID_ARGUMENT"),
        ("DELETE", f"{SESSIONS}/%7B{uuid.UUID(int=1)}%7D", 400, "INVALID_ARGUMENT"),
        ("GET", SESSIONS, 405, "METHOD_NOT_ALLOWED"),
        ("PUT", NO_SESSION, 405, "METHOD_NOT_ALLOWED"),
        ("GET", f"{SESSIONS}/", 404, "NOT_FOUND"),
        ("GET", "/", 404, "NOT_FOUND"),
        ("GET", f"{PROFILES}/QOS_XXL", 404, "NOT_FOUND"),
    ],
)
def test_what_is_not_there_is_told_in_the_same_form(
    api: Api, method: str, path: str, status: int, code: str
) -> None:
    refused(api.send(method, path), status, code)


def test_only_sessions_that_exist_can_be_extended(api: Api) -> None:
    body = {"requestedAdditionalDuration": 60}
    refused(api.send("POST", f"{NO_SESSION}/extend", body), 404, "NOT_FOUND")
    refused(api.send("POST", f"{SESSIONS}/42/extend", body), 400, "INVALID_ARGUMENT")
    body = {"requestedAdditionalDuration": 0}
    refused(api.send("POST", f"{NO_SESSION}/extend", body), 400, "INVALID_ARGUMENT")


@pytest.mark.parametrize("path", ["/health", NO_SESSION, "/nowhere"])
def test_the_correlator_comes_back(api: Api, path: str) -> None:
    reply = api.send("GET", path, headers={"x-correlator": "shift-7/robot:R1"})
    assert reply.headers["x-correlator"] == "shift-7/robot:R1"
    assert api.send("GET", path).headers["x-correlator"]


def test_a_correlator_with_other_characters_is_refused_and_not_echoed(api: Api) -> None:
    reply = api.send("GET", "/health", headers={"x-correlator": "a b"})
    refused(reply, 400, "INVALID_ARGUMENT")
    assert reply.headers["x-correlator"] != "a b"


def test_profiles_say_what_the_ladder_gives(api: Api) -> None:
    names = [profile["name"] for profile in api.send("GET", PROFILES).body]
    assert names == ["QOS_E", "QOS_S", "QOS_M", "QOS_L"]
    top = api.send("GET", f"{PROFILES}/QOS_L").body
    fusion = ladder.shape(1_000_000, ladder.TOP).classes[TrafficClass.FUSION].rate_bps
    assert f"{fusion / 1e6:.0%} of the link" in top["description"]
    assert top["status"] == "ACTIVE"
    assert top["maxDuration"] == {"value": 86_400, "unit": "Seconds"}


def test_the_page_about_the_profiles_says_what_the_ladder_gives() -> None:
    page = (REPOSITORY / "docs" / "qod.md").read_text()
    for name, level in LEVELS.items():
        classes = ladder.shape(1_000_000, level).classes
        fusion, background = classes[TrafficClass.FUSION], classes[TrafficClass.BACKGROUND]
        assert fusion.priority < background.priority
        shares = " | ".join(f"{one.rate_bps / 1e4:.0f} %" for one in (fusion, background))
        assert f"| `{name}` | {level} | {shares} |" in page


def test_with_a_device_profiles_say_the_rate_on_its_link(api: Api) -> None:
    body = {"device": device("10.77.0.3")}
    profiles = api.send("POST", RETRIEVE_PROFILES, body).body
    rates = {one["name"]: one["targetMinDownstreamRate"] for one in profiles}
    assert rates["QOS_L"] == {"value": 9, "unit": "Mbps"}
    assert rates["QOS_S"] == {"value": 5, "unit": "Mbps"}
    only = api.send("POST", RETRIEVE_PROFILES, {"name": "QOS_M"}).body
    assert [one["name"] for one in only] == ["QOS_M"]
    assert "targetMinDownstreamRate" not in only[0]
    assert api.send("POST", RETRIEVE_PROFILES, {"status": "INACTIVE"}).body == []


OTHER_NAMES = ["evil.example", "evil.example:9104", "10.0.0.1", "[::"]


@pytest.mark.parametrize("host", OTHER_NAMES)
def test_a_name_that_somebody_had_lead_here_is_refused(api: Api, host: str) -> None:
    reply = api.send("POST", SESSIONS, wish(), headers={"Host": host})
    assert "this host's own addresses" in refused(reply, 403, "PERMISSION_DENIED")
    assert api.send("GET", PROFILES, headers={"Host": host}).status == 403
    assert not api.links.holds


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9", "127.0.0.1:8080", "[::1]:8080"])
def test_this_hosts_own_names_are_answered(api: Api, host: str) -> None:
    assert api.send("GET", PROFILES, headers={"Host": host}).status == 200


def test_under_another_name_only_that_of_the_list_is_answered_also_with_a_token() -> None:
    headers = {"Authorization": "Bearer right-token", "Host": "qod.plant"}
    with served(token="right-token") as api:
        reply = api.send("POST", SESSIONS, wish(), headers=headers)
        assert "COADAPT_QOD_NAMES" in refused(reply, 403, "PERMISSION_DENIED")
    with served(token="right-token", names=["QoD.plant"]) as api:
        assert api.send("POST", SESSIONS, wish(), headers=headers).status == 201
        assert api.send("GET", PROFILES, headers={"Host": "qod.plant"}).status == 401


def test_with_a_token_only_health_and_the_document_are_open() -> None:
    with served(token="right-token") as api:
        assert api.send("GET", "/health").status == 200
        assert api.send("GET", "/openapi.json").status == 200
        for shown in (None, "Bearer wrong", "Bearer", "Basic right-token", "right-token"):
            headers = {"Authorization": shown} if shown else {}
            for path in (NO_SESSION, PROFILES, "/nowhere"):
                reply = api.send("GET", path, headers=headers)
                refused(reply, 401, "UNAUTHENTICATED")
                assert reply.headers["www-authenticate"] == "Bearer"
            assert api.send("POST", SESSIONS, wish(), headers=headers).status == 401
        right = {"Authorization": "Bearer right-token"}
        assert api.send("GET", PROFILES, headers=right).status == 200
        assert api.send("POST", SESSIONS, wish(), headers=right).status == 201


def test_requests_are_counted_by_method_and_class_of_status() -> None:
    with served() as api:
        api.send("GET", "/health")
        api.send("BREW", "/health")
        api.create(duration=0)
        assert api.count("coadapt_qod_requests_total", method="GET", status="2xx") == 1
        assert api.count("coadapt_qod_requests_total", method="other", status="4xx") == 1
        assert api.count("coadapt_qod_requests_total", method="POST", status="4xx") == 1


def test_the_document_describes_what_is_answered(api: Api) -> None:
    document = api.send("GET", "/openapi.json").body
    assert document["openapi"].startswith("3.1")
    create = document["paths"][SESSIONS]["post"]
    assert create["operationId"] == "createSession"
    assert {"201", "400", "404", "409", "415", "422"} <= set(create["responses"])
    assert "401" not in create["responses"]
    with served(token="right-token") as guarded:
        create = guarded.send("GET", "/openapi.json").body["paths"][SESSIONS]["post"]
        assert create["security"] == [{"token": []}]
        assert "401" in create["responses"]
    schemas = document["components"]["schemas"]
    session = schemas["SessionInfo"]
    assert set(api_fields := session["required"]) >= {"sessionId", "duration", "qosStatus"}
    created = api.create(device=device("10.77.0.3")).body
    assert set(api_fields) <= set(created) <= set(session["properties"])
    references = [part.split('"')[0] for part in json.dumps(document).split("/schemas/")[1:]]
    assert set(references) <= set(schemas)
    for path in document["paths"]:
        assert path in {"/health"} or path.startswith(("/quality-on-demand/v1/", "/qos-profiles/"))


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.0.2.1", "example.com"])
def test_off_the_loopback_a_token_is_needed(host: str) -> None:
    with pytest.raises(SettingError, match=r"COADAPT_QOD_HOST = .*COADAPT_QOD_TOKEN"):
        Server(Links(), host, 0, "", CollectorRegistry(), LOG)


def test_with_a_token_any_address_of_the_host_will_do() -> None:
    server = Server(Links(), "0.0.0.0", 0, "right-token", CollectorRegistry(), LOG)
    server.close()


def test_a_token_that_no_header_can_carry_is_refused_without_being_told() -> None:
    with pytest.raises(SettingError, match="COADAPT_QOD_TOKEN") as caught:
        Server(Links(), "127.0.0.1", 0, "not a token", CollectorRegistry(), LOG)
    assert "not a token" not in str(caught.value)


def test_a_port_in_use_is_refused_with_the_setting_to_change(api: Api) -> None:
    with pytest.raises(SettingError, match=rf"COADAPT_QOD_PORT = {api.server.port} "):
        Server(Links(), "127.0.0.1", api.server.port, "", CollectorRegistry(), LOG)


def test_the_port_is_free_after_closing_and_a_server_may_never_have_started() -> None:
    server = Server(Links(), "127.0.0.1", 0, "", CollectorRegistry(), LOG)
    port = server.port
    server.close()
    again = Server(Links(), "127.0.0.1", port, "", CollectorRegistry(), LOG)
    again.start()
    again.close()
    again.close()


def test_a_unix_socket_is_for_its_owner_only_and_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "qod.sock"
    server = Server(Links(), "0.0.0.0", 0, "", CollectorRegistry(), LOG, socket=str(path))
    server.start()
    try:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with closing(socket.socket(socket.AF_UNIX)) as to:
            to.settimeout(10)
            to.connect(str(path))
            to.sendall(b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            answer = b"".join(iter(lambda: to.recv(4096), b""))
        assert answer.startswith(b"HTTP/1.1 200")
        with pytest.raises(SettingError, match="COADAPT_QOD_SOCKET"):
            Server(Links(), "", 0, "", CollectorRegistry(), LOG, socket=str(path))
    finally:
        server.close()
    assert not path.exists()


def test_a_stale_unix_socket_is_replaced_but_a_file_is_not(tmp_path: Path) -> None:
    path = tmp_path / "qod.sock"
    with closing(socket.socket(socket.AF_UNIX)) as left:
        left.bind(str(path))
    Server(Links(), "", 0, "", CollectorRegistry(), LOG, socket=str(path)).close()
    path.write_text("mine")
    with pytest.raises(SettingError, match="COADAPT_QOD_SOCKET"):
        Server(Links(), "", 0, "", CollectorRegistry(), LOG, socket=str(path))
    assert path.read_text() == "mine"
