"""A type checker accepts what users write, and reports their mistakes before anything runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

RIGHT = """
from fractions import Fraction
from typing import assert_type

import numpy as np
import teg

x, y = teg.vars("x y")
t, a = teg.params("t a")
V, F, k = teg.array("V", 2), teg.indices("F", 2), teg.index("k")
area = teg.integral(teg.bracket((x + a * y < t) & ~(x < 0.1)) * teg.exp(a * x), (x, 0, 1), (y, -np.float64(1), Fraction(1, 2)))
assert_type(area, teg.Expr)
assert_type(2 * area / np.float32(3) - k, teg.Expr)
assert_type(x < np.int64(2), teg.Cond)
pair = teg.tuple(area, (t, 1.5))
both = teg.integral(teg.tuple(x, t), (x, 0, 1))
assert_type(both, teg.Tuple)
assert_type(teg.substitute(both, {t: 1}), teg.Tuple)
assert_type(teg.stop_delta(x < t), teg.Cond)


def scaled(e: teg.Expr | float, by: teg.Param, over: teg.Var, entries: teg.Array, at: teg.Index) -> teg.Expr:
    return teg.let({"u": by * entries[at]}, e * teg.var("u") * over)


print(scaled(2.0, t, x, teg.array("W"), k), teg.diff(area, x), teg.jvp(x * y, {x: 1, y: t}), teg.grad(x * t, [x, t]))
total = teg.sum(V[F[k, 0], 1] * t, (k, 0, teg.length(F)))
pixel = teg.nearest(V[k, 0], x, (k, 0, 3), where=x < t, otherwise=0.0)
f = teg.compile(area, [t, a], backend="c", rule="gauss", order=8, discontinuities="exact", inaccurate="raise", dtype=np.float32)
assert_type(f, teg.Evaluator)
value, gradient = f.value_and_grad(0.5, a=np.linspace(0, 1, 3))
print(gradient["t"], teg.grad(area, [t, a])[0], teg.diff(area, t) + 1, teg.evaluate(area, {t: 0.5}, a=1.0, backend="numpy"))
print(teg.where(x < t, pair, 0)[1], (pair + 1)[0], len(teg.diff(pair, t)), len(both), abs(t), round(t), total, pixel)
print(teg.explain(area, tol=1e-8), teg.jax_function(area, kernel="xla"), teg.scipy_function(area, [t], fixed={"a": 1.0}))
"""

WRONG = """
import teg

x, t = teg.var("x"), teg.param("t")
V, k = teg.array("V"), teg.index("k")
e = teg.integral(x * t, (x, 0, 1))
teg.compile(e, backend="C")
teg.compile(e, rule="simpson")
teg.compile(e, discontinuities="blur")
teg.compile(e, inaccurate=True)
teg.compile(x < t)
teg.compile((x, t))
teg.integral(x, (x, 0, "b"))
teg.integral(x, (t, 0, 1))
teg.integral(x, (0, x, 1))
teg.integral(x, x, 0, 1)
teg.sin("x")
teg.sin(V)
teg.where(t, 1, 2)
teg.bracket(t)
teg.sum([x, t])
teg.sum(V[k], (x, 0, 1))
teg.exp(x < t)
teg.maximum([x, t])
teg.grad(e, ["t"])
teg.explain(e, derivativs=1)
t + "1"
t < None
(x < t) * 2
(x < t) & t
t & (x < t)
V + 1
V[x]
e.parametrs
"""


def checked(program: str, folder: Path) -> dict[int, str]:
    """The messages of mypy on a program, by line."""
    file = folder / "program.py"
    file.write_text(program, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--cache-dir", str(folder / "cache"), str(file)]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    found = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert not found.stderr, found.stderr
    rows = (line.split(":", 2) for line in found.stdout.splitlines() if ": error:" in line)
    return {int(number): message for path, number, message in rows if path.endswith("program.py")}


def test_mypy_accepts_what_is_right_and_reports_what_is_wrong(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    lines = WRONG.splitlines()
    first = lines.index('teg.compile(e, backend="C")') + 1
    wrong = checked(WRONG, tmp_path)
    assert [line for number, line in enumerate(lines, 1) if number >= first and number not in wrong] == []
    assert all(number >= first for number in wrong)
    assert checked(RIGHT, tmp_path) == {}


def lines_that_pyright_reports(program: str, folder: Path) -> set[int]:
    """The lines with errors. Skips the test where pyright cannot fetch what it needs."""
    (folder / "program.py").write_text(program, encoding="utf-8")
    (folder / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(ROOT)]}), encoding="utf-8")
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable, "--project", str(folder)]
    found = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    if not found.stdout.lstrip().startswith("{"):
        pytest.skip(f"pyright does not run: {found.stderr[-200:]}")
    reports = json.loads(found.stdout)["generalDiagnostics"]
    return {report["range"]["start"]["line"] + 1 for report in reports if report["severity"] == "error"}


def test_pyright_accepts_what_is_right_and_reports_what_is_wrong(tmp_path: Path) -> None:
    pytest.importorskip("pyright")
    lines = WRONG.splitlines()
    first = lines.index('teg.compile(e, backend="C")') + 1
    assert lines_that_pyright_reports(WRONG, tmp_path) == set(range(first, len(lines) + 1))
    assert lines_that_pyright_reports(RIGHT, tmp_path) == set()
