"""Typed messages over a real router: what is invalid is dropped, counted and answered."""

from __future__ import annotations

import functools
import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from typing import Any

import msgspec
import pytest
import zenoh
from prometheus_client import CollectorRegistry

from swarm import keyspace, transport, zenoh_config
from swarm.chunks import PART_BYTES, AskParts, MoreParts, split
from swarm.errors import KeyspaceError, MessageError, PerceptionError, RefusedError, TransportError
from swarm.messages import (
    MAX_MESSAGE_BYTES,
    Beacon,
    Observation,
    ObservationRequest,
    encode,
)
from swarm.session import MAX_WAITING_QUERIES, Answer, Session
from swarm.traffic import LINKS
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import (
    WAIT_S,
    Inbox,
    RouterProcess,
    SessionMaker,
    until,
    wait_until_served,
)

BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
REQUEST = ObservationRequest(ego="E1", request=5, algorithm="early", capture_ns=0)
Pair = tuple[Session, Session]


def observation(request: ObservationRequest, payload: bytes = b"scan") -> Observation:
    return Observation(
        robot="R1",
        instance=1,
        request=request.request,
        algorithm=request.algorithm,
        capture_ns=1,
        frame=1,
        pose=(0.0,) * 6,
        payload=payload,
        encode_ms=1.0,
    )


def ask(asker: Session, request: ObservationRequest = REQUEST) -> Future[Answer[Observation]]:
    key = keyspace.observation(asker.swarm, "R1")
    return asker.ask(key, request, Observation, timeout_s=5.0)


def serve(
    pair: Pair,
    handler: Callable[[ObservationRequest], Observation],
    *,
    robot: str = "R1",
    **options: Any,
) -> None:
    """The first session answers for a robot, and the second one knows."""
    key = keyspace.observation(pair[0].swarm, robot)
    pair[0].serve(key, ObservationRequest, handler, **options)
    wait_until_served(pair[1], key)


def raw_zenoh(router: RouterProcess) -> zenoh.Session:
    return transport.open_zenoh(zenoh_config.client_config(router.address), timeout_s=10)


def ready(subscriber: Session, sender: Session, inbox: Inbox[Beacon]) -> None:
    """Puts until what was put last has come, so that nothing is on its way any more: a
    subscription takes a moment to reach the sender."""
    key = keyspace.beacon(sender.swarm, BEACON.robot)
    for seq in range(9):
        sender.put(key, msgspec.structs.replace(BEACON, seq=seq))
        with suppress(queue.Empty):
            inbox.next_where(lambda b, seq=seq: b.seq == seq, 0.1 * 2**seq)  # type: ignore[misc]
            return
    raise AssertionError("no message arrived")


def test_a_published_message_arrives_as_it_was(pair: Pair) -> None:
    inbox: Inbox[Beacon] = Inbox()
    pair[1].subscribe(keyspace.beacon(pair[1].swarm, keyspace.ANY), Beacon, inbox.put)
    ready(pair[1], pair[0], inbox)
    pair[0].put(keyspace.beacon(pair[0].swarm, "R1"), BEACON)
    assert inbox.next() == BEACON


def test_what_does_not_validate_is_dropped_and_counted_and_the_subscriber_goes_on(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    registry = CollectorRegistry()
    subscriber = open_session(shared_router.address, registry=registry)
    inbox: Inbox[Beacon] = Inbox()
    swarm = subscriber.swarm
    subscriber.subscribe(keyspace.beacon(swarm, keyspace.ANY), Beacon, inbox.put)
    key = keyspace.beacon(swarm, "R1")
    bad = [
        b"",
        b"garbage",
        encode(BEACON)[:-3],
        encode(REQUEST),
        b"\x81\xa1x" + b"\x91" * 10_000,
    ]
    with raw_zenoh(shared_router) as sender:
        ready(subscriber, open_session(shared_router.address), inbox)
        good = encode(BEACON)
        sent = [*((key, data) for data in bad), (keyspace.beacon(swarm, "R2"), good), (key, good)]
        for where, data in sent:
            # Block, so that none is lost on the way.
            sender.put(where, data, congestion_control=zenoh.CongestionControl.BLOCK)
        assert inbox.next() == BEACON
    assert inbox.empty()
    dropped = registry.get_sample_value("coadapt_messages_invalid_total", {"kind": "Beacon"})
    assert dropped == len(bad) + 1


def test_a_handler_that_fails_gets_the_next_message_all_the_same(pair: Pair) -> None:
    inbox: Inbox[Beacon] = Inbox()

    def handle(message: Beacon) -> None:
        inbox.put(message)
        raise RuntimeError("handler")

    pair[1].subscribe(keyspace.beacon(pair[1].swarm, keyspace.ANY), Beacon, handle)
    ready(pair[1], pair[0], inbox)
    pair[0].put(keyspace.beacon(pair[0].swarm, "R1"), BEACON)
    assert inbox.next() == BEACON


def test_a_message_that_misses_its_swarm_does_not_arrive(
    shared_router: RouterProcess, pair: Pair
) -> None:
    inbox: Inbox[Beacon] = Inbox()
    pair[1].subscribe(keyspace.beacon(pair[1].swarm, keyspace.ANY), Beacon, inbox.put)
    ready(pair[1], pair[0], inbox)
    with Session(shared_router.address, "other", timeout_s=10) as stranger:
        stranger.put(keyspace.beacon("other", "R1"), BEACON)
        pair[0].put(keyspace.beacon(pair[0].swarm, "R1"), BEACON)
        inbox.next()
    assert inbox.empty()


def test_an_answer_tells_its_bytes_and_its_round_trip(pair: Pair) -> None:
    serve(pair, observation)
    answer = ask(pair[1]).result(WAIT_S)
    assert answer.message.request == REQUEST.request
    assert answer.wire_bytes == len(encode(answer.message))
    assert answer.round_trip_s > 0


LARGE = bytes(range(256)) * 8_000


def test_a_large_answer_comes_whole_and_tells_all_its_bytes(pair: Pair) -> None:
    serve(pair, lambda request: observation(request, LARGE))
    answer = ask(pair[1]).result(WAIT_S)
    assert answer.message.payload == LARGE
    assert answer.wire_bytes == len(encode(answer.message))
    assert pair[1].links() == LINKS


def test_large_answers_of_one_robot_do_not_mix(pair: Pair) -> None:
    def handle(request: ObservationRequest) -> Observation:
        return observation(request, bytes([request.request]) * len(LARGE))

    serve(pair, handle)
    requests = [
        ObservationRequest(ego="E1", request=number, algorithm="early", capture_ns=0)
        for number in (1, 2, 3, 4)
    ]
    for future, request in [(ask(pair[1], request), request) for request in requests]:
        assert future.result(WAIT_S).message.payload == bytes([request.request]) * len(LARGE)


def test_an_asker_that_knows_of_no_parts_gets_a_large_answer_as_one_reply(
    shared_router: RouterProcess, pair: Pair
) -> None:
    serve(pair, lambda request: observation(request, LARGE))
    key = keyspace.observation(pair[0].swarm, "R1")
    with raw_zenoh(shared_router) as asker:
        (reply,) = asker.get(key, payload=encode(REQUEST), timeout=WAIT_S)
        assert reply.ok is not None
        assert reply.ok.attachment is None
        assert reply.ok.payload.to_bytes() == encode(observation(REQUEST, LARGE))


def test_a_server_sends_as_far_as_credit_goes_and_stops_when_its_asker_has_stopped(
    shared_router: RouterProcess, pair: Pair
) -> None:
    serve(pair, lambda request: observation(request, LARGE), workers=1)
    key = keyspace.observation(pair[0].swarm, "R1")
    with raw_zenoh(shared_router) as asker:
        # The asker itself waits longer than it tells, and so sees what comes after.
        replies = asker.get(
            key,
            payload=encode(REQUEST),
            attachment=AskParts(token=1, timeout_s=2.0, parts=2).pack(),
            timeout=WAIT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        seen = [next(replies), next(replies)]
        list(asker.get(key, attachment=MoreParts(token=1, parts=3).pack(), timeout=WAIT_S))
        seen += list(replies)
    parts = [reply.ok.payload.to_bytes() for reply in seen if reply.ok is not None]
    assert parts == [part for _, part in split(encode(observation(REQUEST, LARGE)))][:3]
    # The server's only thread is free again.
    assert ask(pair[1]).result(WAIT_S).message.payload == LARGE


def test_a_request_whose_asker_has_stopped_waiting_is_not_handled(
    shared_router: RouterProcess, pair: Pair
) -> None:
    go = threading.Event()
    begun: Inbox[int] = Inbox()

    def slow(request: ObservationRequest) -> Observation:
        begun.put(request.request)
        go.wait(WAIT_S)
        return observation(request)

    serve(pair, slow, workers=1)
    key = keyspace.observation(pair[0].swarm, "R1")
    first = ask(pair[1])
    assert begun.next() == REQUEST.request
    late = ObservationRequest(ego="E1", request=6, algorithm="early", capture_ns=0)
    with pytest.raises(TransportError, match="none came in time"):
        pair[1].ask(key, late, Observation, timeout_s=0.2).result(WAIT_S)
    # The server's time begins with the request's arrival, a little later.
    time.sleep(0.3)
    go.set()
    assert first.result(WAIT_S).message.request == REQUEST.request
    last = ObservationRequest(ego="E1", request=7, algorithm="early", capture_ns=0)
    assert ask(pair[1], last).result(WAIT_S).message.request == 7
    assert begun.next() == 7


def test_an_answer_too_large_for_a_message_is_refused_where_it_was_made(pair: Pair) -> None:
    serve(pair, lambda request: observation(request, bytes(MAX_MESSAGE_BYTES)))
    with pytest.raises(RefusedError, match=rf"the answer has \d+ bytes.*{MAX_MESSAGE_BYTES}"):
        ask(pair[1]).result(WAIT_S)


@pytest.mark.parametrize(
    ("choose", "error", "says"),
    [
        (lambda parts: parts[:-1], TransportError, "incomplete answer .*missing is 2"),
        (lambda parts: parts[1:], TransportError, "incomplete answer .*missing is 0"),
        (lambda parts: [parts[0], parts[0]], MessageError, "came twice"),
        (lambda parts: [(b"\x01", parts[0][1])], MessageError, "description of a part"),
        (lambda parts: [parts[0], (parts[1][0], b"")], MessageError, "has 0 bytes"),
    ],
)
def test_parts_that_make_no_answer_are_told(
    shared_router: RouterProcess,
    open_session: SessionMaker,
    choose: Callable[[list[tuple[bytes, bytes]]], list[tuple[bytes, bytes]]],
    error: type[Exception],
    says: str,
) -> None:
    asker = open_session(shared_router.address)
    key = keyspace.observation(asker.swarm, "R1")
    parts = split(encode(observation(REQUEST, bytes(2 * PART_BYTES))))

    def answer(query: zenoh.Query) -> None:
        with query:
            if query.payload:
                for attachment, part in choose(parts):  # type: ignore[arg-type]
                    query.reply(key, part, attachment=attachment)

    with raw_zenoh(shared_router) as server:
        queryable = server.declare_queryable(key, answer, complete=True)
        caught: BaseException | None = None
        for _ in range(200):
            caught = ask(asker).exception(WAIT_S)
            if "nobody serves it" not in str(caught):
                break
        queryable.undeclare()
    assert isinstance(caught, error)
    with pytest.raises(error, match=says):
        raise caught


def test_a_refusal_carries_the_reason(pair: Pair) -> None:
    def refuse(request: ObservationRequest) -> Observation:
        raise PerceptionError("no frame yet")

    serve(pair, refuse)
    with pytest.raises(RefusedError, match="no frame yet"):
        ask(pair[1]).result(WAIT_S)


def test_a_fault_of_the_handler_is_refused_without_its_inner_life(pair: Pair) -> None:
    def fail(request: ObservationRequest) -> Observation:
        raise ZeroDivisionError("secret detail")

    serve(pair, fail)
    with pytest.raises(RefusedError, match="internal error: ZeroDivisionError") as caught:
        ask(pair[1]).result(WAIT_S)
    assert "secret" not in str(caught.value)


def test_a_request_that_does_not_validate_is_refused_and_counted(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    registry = CollectorRegistry()
    server = open_session(shared_router.address, registry=registry)
    key = keyspace.observation(server.swarm, "R1")
    server.serve(key, ObservationRequest, observation)
    _first_answer(open_session(shared_router.address)).result(WAIT_S)
    with raw_zenoh(shared_router) as asker:
        for data in (b"", b"garbage", encode(BEACON)):
            (reply,) = asker.get(key, payload=data, timeout=5.0)
            assert reply.err is not None
            assert b"not a valid ObservationRequest" in reply.err.payload.to_bytes()
        # A query without any payload.
        (reply,) = asker.get(key, timeout=5.0)
        assert reply.err is not None
    count = registry.get_sample_value(
        "coadapt_messages_invalid_total", {"kind": "ObservationRequest"}
    )
    assert count == 4
    assert _first_answer(open_session(shared_router.address)).result().message.payload == b"scan"


def test_an_answer_that_does_not_validate_is_a_message_error(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    asker = open_session(shared_router.address)
    key = keyspace.observation(asker.swarm, "R1")

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(key, b"garbage")

    with raw_zenoh(shared_router) as server:
        queryable = server.declare_queryable(key, answer, complete=True)
        with pytest.raises(MessageError, match="Observation"):
            _first_answer(asker).result(WAIT_S)
        queryable.undeclare()


def _first_answer(asker: Session) -> Future[Answer[Observation]]:
    """Asks until somebody serves: a queryable takes a moment to reach the asker."""
    while True:
        future = ask(asker)
        if not isinstance(future.exception(WAIT_S), TransportError):
            return future


def test_a_server_with_too_many_requests_says_that_it_is_busy(pair: Pair) -> None:
    go = threading.Event()
    begun: Inbox[int] = Inbox()

    def slow(request: ObservationRequest) -> Observation:
        begun.put(request.request)
        go.wait(WAIT_S)
        return observation(request)

    serve(pair, slow, workers=1)
    first = ask(pair[1])
    begun.next()
    rest = [ask(pair[1]) for _ in range(MAX_WAITING_QUERIES)]
    refused = wait(rest, WAIT_S, return_when=FIRST_COMPLETED).done
    go.set()
    assert len(refused) == 1
    with pytest.raises(RefusedError, match="16 requests are waiting") as caught:
        refused.pop().result()
    assert caught.value.code == "busy"
    answered = [future.exception(WAIT_S) for future in (first, *rest)]
    assert answered.count(None) == MAX_WAITING_QUERIES


@pytest.fixture
def in_turn(pair: Pair) -> Iterator[tuple[threading.Event, list[int]]]:
    """A server that takes the newest request first, three at a time, and is held at the first one,
    number 1; what it has handled so far."""
    go, handled = threading.Event(), []
    begun = threading.Event()

    def slow(request: ObservationRequest) -> Observation:
        handled.append(request.request)
        begun.set()
        assert go.wait(WAIT_S)
        return observation(request)

    serve(pair, slow, workers=1, waiting=3, newest_first=True)
    ask(pair[1], numbered(1))
    assert begun.wait(WAIT_S)
    yield go, handled
    go.set()


def numbered(number: int) -> ObservationRequest:
    return ObservationRequest(ego="E1", request=number, algorithm="early", capture_ns=0)


def queued(pair: Pair, *numbers: int) -> list[Future[Answer[Observation]]]:
    """Requests that have come one after the other."""
    queue = pair[0]._servers[0]._places._waiting
    futures = []
    for number in numbers:
        newest = queue[-1] if queue else None
        futures.append(ask(pair[1], numbered(number)))
        until(lambda newest=newest: bool(queue) and queue[-1] is not newest, "it has come")  # type: ignore[misc]
    return futures


def test_a_request_that_would_wait_beyond_its_deadline_is_refused_at_once(pair: Pair) -> None:
    go, begun = threading.Event(), threading.Event()

    def slow(request: ObservationRequest) -> Observation:
        if request.request == 1:
            time.sleep(0.05)
        else:
            begun.set()
            assert go.wait(WAIT_S)
        return observation(request)

    serve(pair, slow, workers=1, newest_first=True)
    try:
        # The first one is always answered, however short its time: so the server learns.
        hasty = {"deadline_s": 0.001}
        assert ask(pair[1], msgspec.structs.replace(numbered(1), **hasty)).result(WAIT_S)
        patient = ask(pair[1], numbered(2))
        assert begun.wait(WAIT_S)
        with pytest.raises(RefusedError, match="busy: this would wait for") as refused:
            ask(pair[1], msgspec.structs.replace(numbered(3), **hasty)).result(WAIT_S)
        assert refused.value.code == "busy"
    finally:
        go.set()
    assert patient.result(WAIT_S).message.request == 2


def test_the_newest_request_is_answered_first_where_a_server_says_so(
    pair: Pair, in_turn: tuple[threading.Event, list[int]]
) -> None:
    go, handled = in_turn
    rest = queued(pair, 2, 3)
    go.set()
    for future in rest:
        future.result(WAIT_S)
    assert handled == [1, 3, 2]


def test_the_oldest_request_gives_way_where_the_newest_is_answered_first(
    pair: Pair, in_turn: tuple[threading.Event, list[int]]
) -> None:
    go, handled = in_turn
    rest = queued(pair, 2, 3, 4, 5)
    for crowded_out in rest[:2]:
        with pytest.raises(RefusedError, match="busy"):
            crowded_out.result(WAIT_S)
    go.set()
    for future in rest[2:]:
        future.result(WAIT_S)
    assert handled == [1, 5, 4]


def test_a_stranger_who_takes_all_places_and_no_parts_keeps_nobody_out(
    shared_router: RouterProcess, pair: Pair
) -> None:
    serve(pair, lambda request: observation(request, LARGE), workers=3, newest_first=True)
    key = keyspace.observation(pair[0].swarm, "R1")
    stranger = ObservationRequest(ego="stranger", request=1, algorithm="early", capture_ns=0)
    with raw_zenoh(shared_router) as asker:
        for token in range(3 * MAX_WAITING_QUERIES):
            attachment = AskParts(token, timeout_s=3600.0, parts=1).pack()
            # Its answers are never taken, and its credit never grows.
            asker.get(key, lambda _: None, payload=encode(stranger), attachment=attachment)
        until(lambda: bool(pair[0]._servers[0]._places._waiting), "the stranger waits")
        for number in range(5):
            answer = ask(pair[1], numbered(number)).result(WAIT_S)
            assert answer.message.payload == LARGE


def test_a_key_that_nobody_serves_is_told_at_once(pair: Pair) -> None:
    with pytest.raises(TransportError, match="nobody serves it"):
        ask(pair[1]).result(WAIT_S)


def test_a_server_that_is_too_slow_is_told_apart(pair: Pair) -> None:
    go = threading.Event()

    def slow(request: ObservationRequest) -> Observation:
        go.wait(WAIT_S)
        return observation(request)

    key = keyspace.observation(pair[1].swarm, "R1")
    serve(pair, slow)
    try:
        with pytest.raises(TransportError, match="none came in time"):
            pair[1].ask(key, REQUEST, Observation, timeout_s=0.5).result(WAIT_S)
    finally:
        go.set()


def test_many_robots_answer_at_the_same_time(pair: Pair) -> None:
    together = threading.Barrier(5)

    def meet(request: ObservationRequest) -> Observation:
        together.wait(WAIT_S)
        return observation(request)

    for i in range(5):
        serve(pair, meet, robot=f"R{i}", workers=1)
    futures = [
        pair[1].ask(
            keyspace.observation(pair[1].swarm, f"R{i}"), REQUEST, Observation, timeout_s=10
        )
        for i in range(5)
    ]
    assert [future.result(WAIT_S).message.request for future in futures] == [5] * 5


def test_robots_join_and_leave(shared_router: RouterProcess, open_session: SessionMaker) -> None:
    watcher = open_session(shared_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    robot = Session(shared_router.address, watcher.swarm, timeout_s=10)
    robot.declare_alive("R1")
    watcher.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    assert events.next() == ("join", "R1")
    assert watcher.alive() == ("R1",)
    robot.declare_alive("R2")
    assert events.next() == ("join", "R2")
    robot.close()
    assert {events.next(), events.next()} == {("leave", "R1"), ("leave", "R2")}
    assert watcher.alive() == ()


def test_a_robot_may_leave_and_come_back_on_one_session(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    watcher, robot = open_session(shared_router.address), open_session(shared_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    watcher.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    robot.declare_alive("R2")
    assert events.next() == ("join", "R2")
    for _ in range(2):
        leave = robot.declare_alive("R1")
        assert events.next() == ("join", "R1")
        leave()
        leave()
        assert events.next() == ("leave", "R1")
        assert watcher.alive() == ("R2",)
    robot.close()
    leave()
    assert events.next() == ("leave", "R2")


def test_a_token_that_is_no_robots_is_left_out(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    watcher = open_session(shared_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    watcher.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    with raw_zenoh(shared_router) as stranger:
        odd = stranger.liveliness().declare_token(f"coadapt/{watcher.swarm}/robot/a b/alive")
        good = stranger.liveliness().declare_token(keyspace.alive(watcher.swarm, "R1"))
        assert events.next() == ("join", "R1")
        assert watcher.alive() == ("R1",)
        odd.undeclare()
        good.undeclare()
        assert events.next() == ("leave", "R1")
    assert events.empty()


def test_a_robot_that_two_processes_host_leaves_with_the_second(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    watcher = open_session(shared_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    watcher.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    first, second = (Session(shared_router.address, watcher.swarm, timeout_s=10) for _ in range(2))
    first.declare_alive("R1")
    assert events.next() == ("join", "R1")
    second.declare_alive("R1")
    second.declare_alive("R2")
    assert events.next() == ("join", "R2")
    first.close()
    second.close()
    assert {events.next(), events.next()} == {("leave", "R1"), ("leave", "R2")}
    assert events.empty()


def test_a_server_goes_on_when_another_of_its_key_closes(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    asker = open_session(own_router.address)
    # A session that lost links and the one that replaces it are such a pair.
    servers = {payload: open_session(own_router.address) for payload in (b"one", b"other")}
    for payload, server in servers.items():
        key = keyspace.observation(asker.swarm, "R1")
        server.serve(key, ObservationRequest, functools.partial(observation, payload=payload))
        wait_until_served(asker, key)
    asked = ask(asker).result().message.payload
    servers.pop(asked).close()
    (left,) = servers
    until(lambda: _payload(asker) == left, "the other one answers")


def _payload(asker: Session) -> bytes | None:
    """Of the answer to one question; None without."""
    with suppress(TransportError):
        return ask(asker).result().message.payload
    return None


def test_a_name_that_is_no_name_opens_no_session(shared_router: RouterProcess) -> None:
    with pytest.raises(KeyspaceError):
        Session(shared_router.address, "a/b", timeout_s=1)


def test_a_closed_session_refuses_everything(pair: Pair) -> None:
    pair[0].close()
    with pytest.raises(TransportError):
        pair[0].put(keyspace.beacon(pair[0].swarm, "R1"), BEACON)
    with pytest.raises(TransportError):
        ask(pair[0]).result(WAIT_S)
    with pytest.raises(TransportError):
        pair[0].alive()
    with pytest.raises(TransportError):
        pair[0].declare_alive("R1")
    assert pair[0].links() == 0
    pair[0].close()


def test_hundreds_of_robots_are_told_to_who_watches_and_asks(
    pair: tuple[Session, Session],
) -> None:
    robots, watcher = pair
    ids = {f"R{number}" for number in range(300)}
    for robot in ids:
        robots.declare_alive(robot)
    joined: set[str] = set()
    watcher.watch_alive(joined.add, joined.discard)
    until(lambda: joined == ids, "all robots have joined")
    assert set(watcher.alive(5.0)) == ids
