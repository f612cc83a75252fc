"""`coadapt up` refuses what cannot be before it starts anything, and says what may be."""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from coadapt.main import main
from deploy import room
from deploy.ports import listen
from deploy.progress import typed
from deploy.spec import factory_robots, make_spec
from deploy.state import State, write_state
from swarm.errors import DeployError
from tests.support.free_ports import free_ports
from tests.support.plain_scans import plain_scans


@pytest.fixture(autouse=True)
def run_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
    (tmp_path / "run").mkdir(mode=0o700)
    return tmp_path / "run"


def refusal(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """What `coadapt up` with these options says last; nothing may have been started."""
    assert main(["up", "--runtime", "netns", "--swarm", "qa", *options]) == 1
    assert main(["list", "--json"]) == 0
    told = capsys.readouterr()
    assert told.out == '{"swarms":[]}\n'
    return told.err.splitlines()[-1]


@pytest.mark.stumble(
    "policy, scenario and model names are checked only after the swarm has started",
    command="make up POLICY=clever",
)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--policy", "clever"], "policy 'clever' is unknown; allowed: coverage, llm, "),
        (["--scenario", "strom"], "scenario 'strom' is not known; allowed: floor, "),
        (["--llm", "embedded", "--llm-model", "gpt9"], "no model 'gpt9': neither a file, nor "),
    ],
)
def test_names_are_checked_before_anything_starts(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refusal(capsys, *options)


def test_metrics_over_tls_need_certificates(capsys: pytest.CaptureFixture[str]) -> None:
    assert "a plain swarm has none: start it with --secure" in refusal(capsys, "--metrics-tls")


@pytest.mark.stumble(
    "DATA without WORLD starts the simulated factory", command="make up DATA=scans"
)
def test_data_says_which_world_is_meant(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = str(plain_scans(tmp_path / "data"))
    refused = ("up", "--runtime", "netns", "--swarm", "qa", "--port-base", "0")
    assert main([*refused, "--data", data]) == 1
    said = capsys.readouterr().err
    assert f"{data} holds plain scans of 2 robots: world scans" in said
    assert f"{data} has the robots R1, R2" in said
    words = refusal(capsys, "--world", "factory", "--data", data)
    assert f"reads no data, but there is --data {data}" in words
    assert f"`make up WORLD=scans DATA={data}`" in words
    # Of another world than the one that is named.
    words = refusal(capsys, "--world", "bag", "--data", data)
    assert words.endswith(f"(it holds plain scans of 2 robots: `make up WORLD=scans DATA={data}`)")


def test_scans_that_cannot_be_read_are_found_out_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = plain_scans(tmp_path / "data")
    for file in (data / "R2").glob("*.npy"):
        file.write_bytes(b"no scan")
    said = refusal(capsys, "--data", str(data))
    assert "R2" in said
    assert ".npy" in said


def test_a_base_of_ports_that_is_not_free_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    base = free_ports(20)
    with listen(base, "a test"):
        said = refusal(capsys, "--port-base", str(base))
    assert said.startswith(f"coadapt: --port-base {base} is not free: ")
    assert f"as {base} is taken" in said


class _Models(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        body = b'{"object": "list", "data": [{"id": "tiny:latest"}]}'
        self.send_response(200 if self.path == "/v1/models" else 404)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        pass


def test_a_model_that_its_server_does_not_list_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), _Models) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        url = f"http://127.0.0.1:{server.server_port}"
        said = refusal(capsys, "--llm", url, "--llm-model", "big")
        # This one is served; what is refused is what comes after.
        later = refusal(capsys, "--llm", url, "--llm-model", "tiny", "--port-base", "0")
        server.shutdown()
        thread.join()
    assert said.endswith(f"model 'big' is not served by {url}/v1; it lists: tiny:latest")
    assert "--port-base 0" in later


@pytest.mark.stumble("--robots 500 prints five hundred ids", command="make up ROBOTS=500")
def test_too_many_robots_are_told_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    said = refusal(capsys, "--robots", "5000")
    assert said == "coadapt: --robots 5000 is not valid; it must be 2 to 1000"


def test_more_robots_than_the_memory_holds_are_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "ROBOT_MB", 10**6)
    said = refusal(capsys, "--robots", "700")
    assert "--robots 700 is not valid; it must be at most 100 here: each takes 1000000 MB" in said


def test_a_long_list_is_told_by_its_ends() -> None:
    with pytest.raises(DeployError, match=r"^robots = 1001 values from 'R1' to 'R1001' is not"):
        make_spec(robots=factory_robots(1001))


@pytest.mark.stumble(
    "bounds in messages are not named as the option is", command="make up ARGS='--q-min 7'"
)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--q-min", "7"], "--q-min 7.0 is not valid; it must be a number >= 0 and <= 1"),
        (["--period", "0"], "--period 0.0 is not valid; it must be seconds >= 0.05 and"),
        (["--comm-range", "-3"], "--comm-range -3.0 is not valid; it must be metres > 0"),
        (["--seed", "-1"], "--seed -1 is not valid; it must be a whole number >= 0"),
        (["--console-port", "70000"], "--console-port 70000 is not valid; it must be a port"),
        (["--port-base", "70000"], "--port-base 70000 is not valid; it must be 1 to"),
    ],
)
def test_bounds_are_named_as_the_option_is(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refusal(capsys, *options)


@pytest.mark.stumble("hints forget which swarm is meant", command="make status SWARM=qa")
def test_hints_carry_the_swarm(capsys: pytest.CaptureFixture[str]) -> None:
    assert typed("status") == "make status"
    assert typed("shape", "qa", rate="5mbit") == "make shape SWARM=qa RATE=5mbit"
    assert main(["status", "--swarm", "qa"]) == 1
    said = capsys.readouterr().err
    assert said == "coadapt: no swarm 'qa' is running; start one with `make up SWARM=qa`\n"


def test_an_installed_wheel_names_its_own_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.progress.is_checkout", lambda: False)
    assert typed("shape", "qa", rate="5mbit") == "coadapt net shape --swarm qa --rate 5mbit"


def record(run_dir: Path, swarm: str, **values: object) -> None:
    """A swarm's record, as `up` leaves it before its processes run."""
    folder = run_dir / swarm
    folder.mkdir()
    spec = make_spec(swarm=swarm, robots=("R1", "R2"), run_dir=str(folder), **values)
    write_state(State(runtime="netns", spec=spec, router="tcp/127.0.0.1:1"))


@pytest.mark.stumble("nothing shows which swarms there are", command="coadapt list")
def test_swarms_of_this_machine_are_listed(
    run_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(run_dir, "qa")
    (run_dir / "broken").mkdir()
    (run_dir / "broken" / "state.json").write_text("{")
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["swarm", "runtime", "robots", "ego", "started", "state", "console"]
    assert lines[1].startswith("broken")
    assert "cannot be read" in lines[1]
    assert lines[2].split()[:4] == ["qa", "netns", "2", "R1"]
    assert "`make up SWARM=qa` starts it again" in lines[2]
    assert main(["status", "--swarm", "other"]) == 1
    assert "(there is broken, qa: see `make list`)" in capsys.readouterr().err
