"""Sessions over real HTTP: created, read, extended, deleted and ended as CAMARA says."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Generator
from datetime import datetime, timedelta

import msgspec
import pytest

from network_controller import ladder
from network_controller.qod.book import Session, SessionBook
from network_controller.qod.destinations import Destinations
from network_controller.qod.messages import CreateSession
from tests.support.qod_client import LOG, RETRIEVE, SESSIONS, Api, Links, device, served, wish
from tests.support.zenoh_fixtures import until


@pytest.fixture(scope="module")
def shared() -> Generator[Api]:
    with served() as api:
        yield api


@pytest.fixture
def api(shared: Api) -> Generator[Api]:
    shared.links.reset()
    yield shared
    for address in shared.links.robots:
        for session in shared.send("POST", RETRIEVE, {"device": device(address)}).body:
            shared.send("DELETE", f"{SESSIONS}/{session['sessionId']}")


def test_a_session_is_available_at_once_and_holds_its_level(api: Api) -> None:
    reply = api.create()
    assert reply.status == 201
    assert reply.headers["content-type"] == "application/json"
    session = reply.body
    assert session["qosStatus"] == "AVAILABLE"
    assert "statusInfo" not in session
    started = datetime.fromisoformat(session["startedAt"])
    ends = datetime.fromisoformat(session["expiresAt"])
    assert ends - started == timedelta(seconds=60)
    assert {name: session[name] for name in wish()} == wish()
    assert api.links.holds == {session["sessionId"]: ("R1", ladder.TOP)}


@pytest.mark.parametrize(
    ("profile", "level"), [("QOS_E", 1), ("QOS_S", 1), ("QOS_M", 2), ("QOS_L", ladder.TOP)]
)
def test_every_profile_is_a_level_of_the_ladder(api: Api, profile: str, level: int) -> None:
    session = api.create(qosProfile=profile).body
    assert api.links.holds[session["sessionId"]] == ("R1", level)


def test_a_session_reads_the_same_until_it_is_deleted(api: Api) -> None:
    session = api.create().body
    path = f"{SESSIONS}/{session['sessionId']}"
    assert api.send("GET", path).body == session
    deleted = api.send("DELETE", path)
    assert (deleted.status, deleted.body) == (204, None)
    assert api.links.holds == {}
    gone = api.send("GET", path)
    assert (gone.status, gone.body["code"]) == (404, "NOT_FOUND")
    assert api.send("DELETE", path).status == 404


def test_an_extension_adds_up_to_what_the_profile_allows(api: Api) -> None:
    session = api.create(duration=3600).body
    path = f"{SESSIONS}/{session['sessionId']}/extend"
    more = api.send("POST", path, {"requestedAdditionalDuration": 60}).body
    assert more["duration"] == 3660
    assert datetime.fromisoformat(more["expiresAt"]) - datetime.fromisoformat(
        session["expiresAt"]
    ) == timedelta(seconds=60)
    most = api.send("POST", path, {"requestedAdditionalDuration": 2_000_000_000})
    assert (most.status, most.body["duration"]) == (200, 86_400)


def test_a_session_that_is_over_cannot_be_extended(api: Api) -> None:
    session = api.create().body
    api.server.lost("R1")
    path = f"{SESSIONS}/{session['sessionId']}/extend"
    refused = api.send("POST", path, {"requestedAdditionalDuration": 60})
    assert refused.status == 409
    assert refused.body["code"] == "QUALITY_ON_DEMAND.SESSION_EXTENSION_NOT_ALLOWED"


def test_only_sessions_of_the_device_are_retrieved(api: Api) -> None:
    mine = api.create().body
    api.create(device=device("10.77.0.3"))
    assert api.send("POST", RETRIEVE, {"device": device("10.77.0.2")}).body == [mine]
    assert api.send("POST", RETRIEVE, {"device": device("10.77.0.4")}).body == []


def test_a_robot_that_left_is_still_known_by_its_sessions(api: Api) -> None:
    session = api.create().body
    del api.links.robots["10.77.0.2"]
    api.server.lost("R1")
    (found,) = api.send("POST", RETRIEVE, {"device": device("10.77.0.2")}).body
    assert found["sessionId"] == session["sessionId"]
    assert (found["qosStatus"], found["statusInfo"]) == ("UNAVAILABLE", "NETWORK_TERMINATED")
    api.links.robots["10.77.0.2"] = "R1"


def test_a_lost_link_ends_its_own_sessions_only(api: Api) -> None:
    lost, kept = api.create().body, api.create(device=device("10.77.0.3")).body
    api.server.lost("R1")
    ended = api.send("GET", f"{SESSIONS}/{lost['sessionId']}").body
    assert (ended["qosStatus"], ended["statusInfo"]) == ("UNAVAILABLE", "NETWORK_TERMINATED")
    assert datetime.fromisoformat(ended["expiresAt"]) < datetime.fromisoformat(lost["expiresAt"])
    assert ended["duration"] < 60
    assert api.send("GET", f"{SESSIONS}/{kept['sessionId']}").body["qosStatus"] == "AVAILABLE"
    assert list(api.links.holds) == [kept["sessionId"]]


def test_after_the_network_ended_a_session_it_must_be_deleted_before_the_next(api: Api) -> None:
    session = api.create().body
    api.server.lost("R1")
    assert api.create().status == 409
    assert api.send("DELETE", f"{SESSIONS}/{session['sessionId']}").status == 204
    assert api.create().status == 201


def test_what_the_kernel_refuses_is_told_as_ended_by_the_network(api: Api) -> None:
    api.links.broken = "tc: no such device"
    reply = api.create()
    assert reply.status == 201
    assert (reply.body["qosStatus"], reply.body["statusInfo"]) == (
        "UNAVAILABLE",
        "NETWORK_TERMINATED",
    )
    assert "startedAt" not in reply.body
    assert api.send("GET", f"{SESSIONS}/{reply.body['sessionId']}").body == reply.body


PORT_80 = {"ports": [80]}


@pytest.mark.parametrize(
    ("first", "second", "status"),
    [
        ({}, {}, 409),
        ({}, {"qosProfile": "QOS_S"}, 409),
        ({}, {"applicationServer": {"ipv4Address": "10.77.0.0/24"}}, 409),
        ({}, {"applicationServer": {"ipv4Address": "10.78.0.1"}}, 201),
        ({}, {"applicationServer": {"ipv6Address": "2001:db8::/64"}}, 201),
        ({}, {"device": device("10.77.0.3")}, 201),
        ({}, {"applicationServerPorts": PORT_80}, 409),
        ({"devicePorts": PORT_80}, {"devicePorts": {"ports": [81]}}, 201),
        (
            {"devicePorts": PORT_80},
            {"devicePorts": {"ports": [81], "ranges": [{"from": 70, "to": 80}]}},
            409,
        ),
    ],
)
def test_sessions_conflict_where_their_flows_overlap(
    api: Api, first: dict[str, object], second: dict[str, object], status: int
) -> None:
    assert api.create(**first).status == 201
    reply = api.create(**second)
    assert reply.status == status
    assert status == 201 or reply.body["code"] == "CONFLICT"


def test_of_many_equal_requests_at_once_one_wins(api: Api) -> None:
    statuses: list[int] = []
    threads = [
        threading.Thread(target=lambda: statuses.append(api.create().status)) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(statuses) == [201] + [409] * 7
    assert len(api.links.holds) == 1


def test_the_gauge_counts_sessions_in_force(api: Api) -> None:
    session = api.create(qosProfile="QOS_M").body
    assert api.count("coadapt_qod_sessions", profile="QOS_M") == 1
    api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
    assert api.count("coadapt_qod_sessions", profile="QOS_M") == 0


def test_closing_the_api_releases_every_hold() -> None:
    with served() as api:
        api.create()
        assert api.links.holds
    assert api.links.holds == {}


class Changes:
    """Hears of changes, and can be waited on."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, str | None]] = []
        self._ended = threading.Event()

    def __call__(self, session: Session) -> None:
        self.seen.append((session.status, session.info))
        if session.status == "UNAVAILABLE":
            self._ended.set()

    def wait_for_the_end(self) -> None:
        assert self._ended.wait(20)


def _request(address: str, duration_s: int) -> CreateSession:
    request = msgspec.convert(wish(device=device(address), duration=duration_s), CreateSession)
    assert isinstance(request, CreateSession)
    return request


REQUEST = _request("10.77.0.2", 1)


def test_a_session_ends_when_its_time_is_over_and_can_still_be_read() -> None:
    links, changes = Links(), Changes()
    book = SessionBook(links, changes, Destinations(), LOG)
    book.start()
    try:
        session = book.create(REQUEST)
        assert session.session_id in links.holds
        changes.wait_for_the_end()
        ended = book.get(session.session_id)
        assert (ended.qos_status, ended.status_info) == ("UNAVAILABLE", "DURATION_EXPIRED")
        assert links.holds == {}
        assert changes.seen == [("AVAILABLE", None), ("UNAVAILABLE", "DURATION_EXPIRED")]
        # Unlike one that the network ended, it does not stand in the way.
        assert book.create(REQUEST).qos_status == "AVAILABLE"
    finally:
        book.close()


def test_an_extension_in_time_keeps_a_session() -> None:
    links, changes = Links(), Changes()
    book = SessionBook(links, changes, Destinations(), LOG)
    book.start()
    try:
        long = book.create(_request("10.77.0.3", 2))
        book.extend(long.session_id, 3600)
        short = book.create(_request("10.77.0.2", 2))
        changes.wait_for_the_end()
        assert book.get(short.session_id).qos_status == "UNAVAILABLE"
        assert book.get(long.session_id).qos_status == "AVAILABLE"
    finally:
        book.close()


def test_a_session_that_ended_is_forgotten_after_a_while() -> None:
    links, changes = Links(), Changes()
    book = SessionBook(links, changes, Destinations(), LOG, keep_s=0.0)
    book.start()
    try:
        session = book.create(REQUEST)
        book.lost("R1")
        until(lambda: not book.of_device(session.device), "the session is forgotten")
    finally:
        book.close()


def test_identifiers_of_sessions_are_uuids(api: Api) -> None:
    session = api.create().body
    assert str(uuid.UUID(session["sessionId"])) == session["sessionId"]
    assert api.send("GET", f"{SESSIONS}/{session['sessionId'].upper()}").status == 200
