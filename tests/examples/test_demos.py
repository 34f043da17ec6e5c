"""What all demonstrations share: one table of options, one line for a mistake, repeated runs, silence in pipes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from teg.__main__ import main
from teg.errors import InputError
from teg.examples.harness import demo_command
from teg.examples.options import DEMOS, OPTIONS, resolved

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")

from teg.examples.bouncing_ball.run import run_bouncing_ball


@pytest.mark.parametrize("name", DEMOS)
def test_every_demo_takes_its_options_from_the_table(name: str) -> None:
    demo = DEMOS[name]
    assert {"seed", "backend"} <= set(demo.defaults) <= set(OPTIONS)
    assert set(demo.fast) <= set(demo.defaults)
    settings = resolved(name, {}, fast=True)
    assert settings["out"] == f"out/{name}"
    assert settings["backend"] in demo.backends
    assert settings | dict(demo.fast) == settings
    with pytest.raises(InputError, match="no option"):
        resolved(name, {"colour": 1})


@pytest.mark.parametrize("name", DEMOS)
def test_a_mistake_is_one_line_and_exit_code_2(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("{}")
    for words in (
        ["--seed", "-1"],
        ["--repeat", str(tmp_path / "file")],
        ["--repeat", str(tmp_path / "none")],
        ["-o", str(tmp_path / "file")],
    ):
        assert main(["demo", name, "--fast", *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    for words in (["--seed", "x"], ["--backend", "fortran"], ["--nothing"]):
        with pytest.raises(SystemExit) as end:
            main(["demo", name, *words])
        assert end.value.code == 2
        error = capsys.readouterr().err
        assert error.splitlines()[-1].startswith(f"teg demo {name}: error: ")
        assert error.count("\n") == 1


def test_the_command_of_a_run_repeats_its_options() -> None:
    settings = resolved("bouncing-ball", {"speed": -1.5, "floor": "-x", "alone": True})
    command = demo_command("bouncing-ball", settings)
    assert "--speed=-1.5" in command
    assert "--floor=-x" in command
    assert "--alone" in command
    assert "--duration" not in command
    assert demo_command("triangulation", resolved("triangulation", {"photo": "a b.png", "seed": 0})).startswith(
        "teg demo triangulation 'a b.png'"
    )


def test_a_run_is_repeated_from_its_report(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["demo", "bouncing-ball", "--fast", "--speed", "1", "--backend", "numpy", "--alone", "-o", str(first)]) == 0
    assert main(["demo", "bouncing-ball", "--repeat", str(first / "run.json"), "-o", str(second)]) == 0
    reports = [json.loads((folder / "run.json").read_text(encoding="utf-8")) for folder in (first, second)]
    assert reports[0]["times"] == reports[1]["times"]
    assert reports[0]["options"] | {"out": ""} == reports[1]["options"] | {"out": ""}
    assert main(["demo", "springs", "--repeat", str(first / "run.json"), "-o", str(second)]) == 2


def test_a_resumed_run_ends_where_the_whole_one_does(tmp_path: Path) -> None:
    for options in ({"contacts": 2}, {"contacts": 1, "floor": "0.1*sin(2*x)"}):
        first = run_bouncing_ball(out=tmp_path, backend="numpy", alone=True, **options)
        again = run_bouncing_ball(out=tmp_path, backend="numpy", alone=True, resume=True, **options)
        for name in ("times", "action"):
            assert again[name] == first[name]
    assert main(["demo", "bouncing-ball", "--contacts", "3", "--resume", "-o", str(tmp_path)]) == 2


def test_a_pipe_sees_no_progress_bar_and_the_backend_is_named(tmp_path: Path) -> None:
    words = ["demo", "bouncing-ball", "--contacts", "1", "--alone", "--backend", "numpy", "-o", str(tmp_path)]
    run = subprocess.run([sys.executable, "-m", "teg", *words], capture_output=True, text=True, check=True)
    assert run.stderr == ""
    assert run.stdout.startswith("backend: numpy\n")
    assert f"page: {tmp_path / 'index.html'}" in run.stdout


@pytest.mark.thorough
@pytest.mark.parametrize("name", DEMOS)
def test_every_demo_runs_fast(name: str, tmp_path: Path) -> None:
    if "jax" in DEMOS[name].backends[:1]:
        pytest.importorskip("optax")
    assert main(["demo", name, "--fast", "--quiet", "-o", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert report["demo"] == name
    assert (tmp_path / "index.html").read_text(encoding="utf-8").count("data:image/") == len(report["pictures"])
