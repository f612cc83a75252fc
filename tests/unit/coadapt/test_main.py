"""What every command of `coadapt` shares."""

from __future__ import annotations

import inspect
import subprocess
import sys
import tomllib

import pytest

import coadapt
from coadapt.main import RESEARCH, build_parser, main
from swarm.defaults import ALGORITHM
from tests.support.paths import REPOSITORY


def test_the_version_is_that_of_the_project(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert capsys.readouterr().out == f"coadapt {project['version']}\n"


@pytest.mark.parametrize(
    "command",
    [
        ["eval", "policies"],
        ["eval", "live"],
        ["eval", "published", "."],
        ["eval-detector"],
        ["train", "--config", "factory"],
        ["picture", "factory", "--output", "never.svg"],
    ],
)
def test_an_experiment_that_is_not_installed_is_said_in_one_line(command: list[str]) -> None:
    code = (
        f"import sys\nsys.modules[{RESEARCH!r}] = None\n"
        f"from coadapt.main import main\nsys.exit(main({command}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.startswith("coadapt: the experiments are not in this installation: ")
    assert len(done.stderr.splitlines()) == 1


def test_another_missing_package_is_a_defect_and_shows_where() -> None:
    code = (
        "import sys\nsys.modules['worlds.clouds.pcd'] = None\n"
        "from coadapt.main import main\nsys.exit(main(['scene', 'some.pcd']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "Traceback" in done.stderr


@pytest.mark.stumble("--algorithm has several defaults", command="coadapt ap  # fuse, picture")
def test_algorithm_has_one_default_everywhere() -> None:
    parser = build_parser()
    commands = (["ap"], ["fuse", "--frame", "1"], ["picture", "factory", "--output", "x.svg"])
    chosen = {parser.parse_args(command).algorithm for command in commands}
    chosen.add(inspect.signature(coadapt.fuse).parameters["algorithm"].default)
    assert chosen == {ALGORITHM}
