"""The gateway's core: one call for equal requests, fair turns, deadlines, batches, retries."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Coroutine
from typing import Any

import pytest

from llm_gateway.dispatch import HANG_S
from llm_gateway.model import Prompt
from swarm.errors import GatewayCode, GatewayError
from swarm.messages import MAX_PROMPT_CHARS
from tests.support.llm_scripted import EARLY, LONG_S, SCHEMA, Scripted, job, rig

LATE = '{"algorithm":"late"}'


def run(work: Coroutine[Any, Any, None]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(LONG_S):
            await work

    asyncio.run(bounded())


async def code_of(work: Coroutine[Any, Any, Any]) -> GatewayCode:
    with pytest.raises(GatewayError) as caught:
        await work
    return caught.value.code


async def settled(backend: Scripted) -> None:
    """Until the model rests and the gateway has seen it."""
    await backend.until(lambda: backend.running == 0)
    for _ in range(3):
        await asyncio.sleep(0)


def saying(*words: str | GatewayError) -> Scripted:
    """A back end that says one after another, the last one again and again."""
    left = list(words)

    async def script(prompt: Prompt, timeout_s: float) -> str:
        said = left.pop(0) if len(left) > 1 else left[0]
        if isinstance(said, GatewayError):
            raise said
        return said

    return Scripted(script)


def failing(code: GatewayCode = "failed") -> GatewayError:
    return GatewayError(code, "as scripted")


def test_a_hundred_equal_requests_make_one_model_call() -> None:
    async def scenario() -> None:
        backend = Scripted()
        async with rig(backend) as made:
            waiting = [
                asyncio.create_task(made.gateway.complete(job(client=f"E{i}"))) for i in range(100)
            ]
            await backend.until(lambda: backend.running == 1)
            backend.go.set()
            done = await asyncio.gather(*waiting)
            assert {answer.text for answer in done} == {EARLY}
            assert {answer.source for answer in done} == {"llm"}
            assert len(backend.asked) == made.count("model_calls_total") == 1
            assert made.count("joined_total") == 99

            again = await made.gateway.complete(job())
            assert (again.source, again.hit, again.text) == ("cache", "exact", EARLY)
            assert len(backend.asked) == 1

    run(scenario())


def test_one_of_many_waiters_may_leave_and_the_last_one_ends_the_call() -> None:
    async def scenario() -> None:
        backend = Scripted()
        async with rig(backend) as made:
            first, second = (asyncio.create_task(made.gateway.complete(job())) for _ in range(2))
            await backend.until(lambda: backend.running == 1)
            first.cancel()
            await asyncio.wait([first])
            assert not backend.cancelled
            second.cancel()
            await backend.until(lambda: backend.running == 0)
            assert backend.cancelled == ["which?"]

    run(scenario())


def test_a_patient_waiter_extends_a_call_and_the_impatient_one_is_told_in_time() -> None:
    async def scenario() -> None:
        backend = Scripted()
        async with rig(backend) as made:
            hasty = asyncio.create_task(made.gateway.complete(job(within_s=2.0)))
            await backend.until(lambda: backend.running == 1)
            patient = asyncio.create_task(made.gateway.complete(job()))
            with pytest.raises(GatewayError, match=r"expired: no answer after .* from the model"):
                await hasty
            backend.go.set()
            assert (await patient).text == EARLY
            assert len(backend.asked) == 1

    run(scenario())


def test_a_request_that_expires_in_the_queue_never_reaches_the_model() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=1)
        async with rig(backend) as made:
            first = asyncio.create_task(made.gateway.complete(job("first")))
            await backend.until(lambda: backend.running == 1)
            with pytest.raises(GatewayError, match=r"expired: .* in the queue"):
                await made.gateway.complete(job("second", within_s=0.05))
            assert await code_of(made.gateway.complete(job("third", within_s=-1))) == "expired"
            backend.go.set()
            await first
            await made.gateway.complete(job("fourth"))
            assert backend.asked == ["first", "fourth"]
            assert made.count("requests_total", source="llm", outcome="expired") == 2

    run(scenario())


def test_the_longest_deadline_is_the_gateways_own() -> None:
    async def scenario() -> None:
        backend = Scripted()
        async with rig(backend, deadline_max_s=0.05) as made:
            assert await code_of(made.gateway.complete(job(within_s=LONG_S))) == "expired"
            await backend.until(lambda: backend.running == 0)

    run(scenario())


def test_jobs_go_by_deadline_and_clients_take_turns() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=1)
        async with rig(backend) as made:
            running = [asyncio.create_task(made.gateway.complete(job("x", client="X")))]
            await backend.until(lambda: backend.running == 1)
            for words, client, within_s in (
                ("greedy 1", "A", 11.0),
                ("greedy 2", "A", 12.0),
                ("greedy 3", "A", 13.0),
                ("later", "B", 15.0),
                ("sooner", "C", 10.0),
            ):
                one = job(words, client=client, within_s=within_s)
                running.append(asyncio.create_task(made.gateway.complete(one)))
            await asyncio.sleep(0)
            assert made.count("queue_depth") == 5
            backend.go.set()
            await asyncio.gather(*running)
            assert backend.asked == ["x", "sooner", "greedy 1", "later", "greedy 2", "greedy 3"]

    run(scenario())


def test_a_full_queue_refuses_unless_the_newcomer_is_more_urgent() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=1)
        async with rig(backend, queue=2, per_client=2) as made:
            running = [asyncio.create_task(made.gateway.complete(job("x", client="X")))]
            await backend.until(lambda: backend.running == 1)
            relaxed = asyncio.create_task(made.gateway.complete(job("1", client="A", within_s=15)))
            running.append(
                asyncio.create_task(made.gateway.complete(job("2", client="B", within_s=10)))
            )
            await asyncio.sleep(0)
            late = made.gateway.complete(job("3", client="C", within_s=18))
            assert await code_of(late) == "busy"
            running.append(
                asyncio.create_task(made.gateway.complete(job("4", client="C", within_s=5)))
            )
            with pytest.raises(GatewayError, match="busy: displaced by a more urgent request"):
                await relaxed
            backend.go.set()
            await asyncio.gather(*running)
            assert backend.asked == ["x", "4", "2"]
            assert made.count("refusals_total", code="busy") == 2

    run(scenario())


def test_a_client_may_only_have_so_many_waiting() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=1)
        async with rig(backend, per_client=2) as made:
            tasks = [asyncio.create_task(made.gateway.complete(job(str(i)))) for i in range(3)]
            await backend.until(lambda: backend.running == 1)
            with pytest.raises(GatewayError, match="2 requests of 'E1' are waiting"):
                await made.gateway.complete(job("one more"))
            backend.go.set()
            await asyncio.gather(*tasks)

    run(scenario())


def test_first_jobs_wait_for_each_other_and_no_more_run_than_the_model_takes() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=4)
        async with rig(backend, window_ms=5_000.0) as made:
            jobs = [job(f"{i}", client=f"E{i}") for i in range(4)]
            tasks = [asyncio.create_task(made.gateway.complete(one)) for one in jobs[:3]]
            await asyncio.sleep(0)
            assert not backend.asked
            # The fourth fills the batch, so that nobody waits for the window's end.
            tasks += [asyncio.create_task(made.gateway.complete(one)) for one in jobs[3:]]
            await backend.until(lambda: backend.running == 4)
            tasks += [asyncio.create_task(made.gateway.complete(job(f"more {i}"))) for i in (1, 2)]
            await asyncio.sleep(0)
            assert made.count("in_flight") == 4
            backend.go.set()
            await asyncio.gather(*tasks)
            assert backend.most == 4
            assert (
                made.count("batch_size_bucket", le="4.0")
                - made.count("batch_size_bucket", le="2.0")
                == 1
            )

    run(scenario())


def test_a_window_ends_by_itself() -> None:
    async def scenario() -> None:
        backend = saying(EARLY)
        async with rig(backend, window_ms=5.0) as made:
            texts = await asyncio.gather(
                made.gateway.complete(job("1")), made.gateway.complete(job("2", client="E2"))
            )
            assert [answer.text for answer in texts] == [EARLY, EARLY]
            assert made.count("batch_size_count") == 1
            # The second one came a moment later, and the window did not wait for it anew.
            assert texts[0].timings.queue_ms >= 4.0

    run(scenario())


def test_an_invalid_answer_is_asked_for_again_and_never_handed_on() -> None:
    async def scenario() -> None:
        backend = saying("I would say early.", '{"algorithm": "none"}', "Sure!\n" + LATE)
        async with rig(backend, breaker_failures=1) as made:
            made.gateway._dispatcher._budget._tokens = 5.0
            assert (await made.gateway.complete(job())).text == LATE
            assert made.count("retries_total") == 2
            assert made.count("invalid_answers_total", reason="no_json") == 1
            assert made.count("invalid_answers_total", reason="schema") == 1
            assert made.count("breaker_state") == 0

    run(scenario())


def test_retries_are_a_share_of_the_calls() -> None:
    async def scenario() -> None:
        backend = saying("nonsense")
        async with rig(backend) as made:
            for i in range(30):
                assert await code_of(made.gateway.complete(job(str(i)))) == "invalid"
            assert made.count("model_calls_total") <= 30 * 1.1 + 3
            assert made.count("model_calls_total") > 30

    run(scenario())


def test_the_breaker_opens_refuses_at_once_and_lets_one_probe_through() -> None:
    async def scenario() -> None:
        broken = True

        async def script(prompt: Prompt, timeout_s: float) -> str:
            if broken:
                raise failing()
            await backend.go.wait()
            return EARLY

        backend = Scripted(script, parallel=1)
        async with rig(backend, breaker_failures=3, breaker_s=60) as made:
            for i in range(3):
                assert await code_of(made.gateway.complete(job(str(i)))) in (
                    "failed",
                    "unavailable",
                )
            while made.count("breaker_state") != 2:
                await code_of(made.gateway.complete(job("more")))
            calls = len(backend.asked)
            with pytest.raises(
                GatewayError, match=r"unavailable: the breaker is open .* as scripted"
            ):
                await made.gateway.complete(job("refused"))
            assert len(backend.asked) == calls
            broken = False
            made.gateway._dispatcher._breaker._until = time.monotonic()
            probe = asyncio.create_task(made.gateway.complete(job("probe")))
            await backend.until(lambda: backend.running == 1)
            assert made.count("breaker_state") == 1
            with pytest.raises(GatewayError, match="unavailable: the breaker lets one request"):
                await made.gateway.complete(job("another"))
            backend.go.set()
            assert (await probe).text == EARLY
            assert made.count("breaker_state") == 0
            # What is known needs no model.
            backend.asked.clear()
            assert (await made.gateway.complete(job("probe"))).hit == "exact"
            assert not backend.asked

    run(scenario())


def test_an_open_breaker_lets_the_cache_answer_and_empties_the_queue() -> None:
    async def scenario() -> None:
        said = [EARLY]

        async def script(prompt: Prompt, timeout_s: float) -> str:
            if said:
                return said.pop()
            await backend.go.wait()
            raise failing("unavailable")

        backend = Scripted(script, parallel=1)
        async with rig(backend, breaker_failures=1, breaker_s=60) as made:
            await made.gateway.complete(job("known"))
            running = asyncio.create_task(made.gateway.complete(job("running")))
            await backend.until(lambda: backend.running == 1)
            waiting = asyncio.create_task(made.gateway.complete(job("waiting")))
            await asyncio.sleep(0)
            backend.go.set()
            with pytest.raises(GatewayError, match="unavailable: the breaker opened"):
                await waiting
            assert await code_of(running) == "unavailable"  # type: ignore[arg-type]
            assert (await made.gateway.complete(job("known"))).hit == "exact"

    run(scenario())


def test_a_probe_that_nobody_waits_for_any_more_makes_room_for_the_next() -> None:
    async def scenario() -> None:
        said: list[str] = []

        async def script(prompt: Prompt, timeout_s: float) -> str:
            if not said:
                raise failing()
            await backend.go.wait()
            return said[0]

        backend = Scripted(script)
        async with rig(backend, breaker_failures=1, breaker_s=0.05) as made:
            await code_of(made.gateway.complete(job("1")))
            said.append(LATE)
            await asyncio.sleep(0.05)
            probe = asyncio.create_task(made.gateway.complete(job("2")))
            await backend.until(lambda: backend.running == 1)
            probe.cancel()
            await settled(backend)
            backend.go.set()
            assert (await made.gateway.complete(job("3"))).text == LATE

    run(scenario())


def test_a_hanging_model_opens_the_breaker_and_hasty_clients_do_not() -> None:
    async def scenario() -> None:
        backend = Scripted()
        async with rig(backend, breaker_failures=1) as made:
            assert await code_of(made.gateway.complete(job("1", within_s=0.05))) == "expired"
            await settled(backend)
            assert made.count("breaker_state") == 0
            patient = job("2", within_s=HANG_S + 2.0)
            assert await code_of(made.gateway.complete(patient)) == "expired"
            await settled(backend)
            assert made.count("breaker_state") == 2

    run(scenario())


def test_closing_tells_those_who_wait() -> None:
    async def scenario() -> None:
        backend = Scripted(parallel=1)
        async with rig(backend) as made:
            tasks = [
                asyncio.create_task(code_of(made.gateway.complete(job(str(i))))) for i in range(3)
            ]
            await backend.until(lambda: backend.running == 1)
            await made.gateway.close()
            assert await asyncio.gather(*tasks) == ["unavailable"] * 3
            assert len(backend.cancelled) == 1
            assert await code_of(made.gateway.complete(job("later"))) == "unavailable"

    run(scenario())


def test_too_large_a_prompt_and_a_wrong_schema_never_reach_the_model() -> None:
    async def scenario() -> None:
        backend = saying(EARLY)
        async with rig(backend) as made:
            large = job("x" * (MAX_PROMPT_CHARS - len(SCHEMA) + 1))
            assert await code_of(made.gateway.complete(large)) == "too_large"
            for schema in (
                "{",
                "[]",
                '{"type": "objekt"}',
                '{"properties": {"a": {"pattern": "a"}}}',
            ):
                with pytest.raises(GatewayError, match="invalid: the request's JSON schema"):
                    await made.gateway.complete(job(schema=schema))
            assert not backend.asked

    run(scenario())


def test_a_fault_of_a_back_end_is_a_failure_and_its_words_stay_unknown() -> None:
    async def scenario() -> None:
        async def script(prompt: Prompt, timeout_s: float) -> str:
            raise KeyError("sk-secret")

        async with rig(Scripted(script)) as made:
            with pytest.raises(
                GatewayError, match="failed: the back end raised KeyError"
            ) as caught:
                await made.gateway.complete(job())
            assert "secret" not in str(caught.value)

    run(scenario())


def test_free_text_comes_back_as_it_is() -> None:
    async def scenario() -> None:
        words = "<think>hm</think> Hello.\n"
        async with rig(saying(words)) as made:
            assert (await made.gateway.complete(job(schema=""))).text == words

    run(scenario())


def test_an_equal_scene_gets_a_known_answer_only_if_it_follows_the_present_schema() -> None:
    async def scenario() -> None:
        narrower = json.dumps({"type": "object", "properties": {"algorithm": {"enum": ["late"]}}})
        scene = "0123456789abcdef"
        async with rig(saying(EARLY, LATE)) as made:
            await made.gateway.complete(job("20 Mbit/s", fingerprint=scene))
            hit = await made.gateway.complete(job("20.1 Mbit/s", fingerprint=scene))
            assert (hit.source, hit.hit, hit.text) == ("cache", "fingerprint", EARLY)
            narrow = job("5 Mbit/s", fingerprint=scene, schema=narrower)
            assert (await made.gateway.complete(narrow)).text == LATE
            other = job("20.1 Mbit/s, other scene", fingerprint="f" * 16)
            assert (await made.gateway.complete(other)).source == "llm"

    run(scenario())


def test_nobody_leaves_answers_for_those_of_another_role() -> None:
    """An HTTP client's answer to an ego's very prompt, or for its scene, is not the ego's."""

    async def scenario() -> None:
        scene = "0123456789abcdef"
        async with rig(saying(EARLY, LATE)) as made:
            complete = made.gateway.complete
            await complete(job(fingerprint=scene, role="http"))
            asked = await complete(job(fingerprint=scene, role="ego"))
            assert (asked.source, asked.text) == ("llm", LATE)
            again = await complete(job(fingerprint=scene, role="ego", client="E2"))
            assert (again.source, again.hit, again.text) == ("cache", "exact", LATE)
            first = await complete(job("otherwise", fingerprint=scene, role="http"))
            assert (first.source, first.hit, first.text) == ("cache", "fingerprint", EARLY)

    run(scenario())


def test_calls_under_way_are_not_shared_with_another_role() -> None:
    async def scenario() -> None:
        async with rig(saying(EARLY, LATE)) as made:
            both = (made.gateway.complete(job(role=role)) for role in ("http", "ego"))
            done = await asyncio.gather(*both)
            assert {one.text for one in done} == {EARLY, LATE}

    run(scenario())


def test_an_equal_scene_is_one_of_the_same_template() -> None:
    async def scenario() -> None:
        scene = "0123456789abcdef"
        async with rig(saying(EARLY, LATE)) as made:
            complete = made.gateway.complete
            await complete(job("20 Mbit/s", fingerprint=scene, system="Say early."))
            other = await complete(job("21 Mbit/s", fingerprint=scene, system="Choose."))
            assert (other.source, other.text) == ("llm", LATE)
            same = await complete(job("22 Mbit/s", fingerprint=scene, system="Choose."))
            assert (same.hit, same.text) == ("fingerprint", LATE)

    run(scenario())


def test_timings_and_tokens_are_told() -> None:
    async def scenario() -> None:
        async with rig(saying(EARLY)) as made:
            begun = time.monotonic()
            done = await made.gateway.complete(job())
            elapsed_ms = (time.monotonic() - begun) * 1e3
            assert done.timings.queue_ms + done.timings.model_ms <= done.timings.total_ms
            assert done.timings.total_ms <= elapsed_ms
            assert (done.tokens.prompt, done.tokens.output, done.model) == (9, 2, "scripted")
            assert made.count("tokens_total", kind="prompt") == 9

    run(scenario())
