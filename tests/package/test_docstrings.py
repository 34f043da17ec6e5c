"""The docstrings of public names and methods: what they return and raise, and examples that run."""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import teg
from teg.interop.jax import JaxFunction
from teg.interop.scipy import VectorFunction
from teg.interop.torch import TorchFunction

REFERENCE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "index.md"
NUMBERS = "abs acos asin atan atan2 ceil cos cosh erf erfc exp expm1 floor log log1p mod round sign sin sinh sqrt tan tanh"
"""The functions of numbers, whose errors are listed once, on the page of the language."""
CANNOT_FAIL = "size dump latex stop_delta polar Evaluator.kernel Evaluator.outputs Evaluator.output_names Diffeomorphism.inverse_map "
CANNOT_FAIL += "Diffeomorphism.renamed Diffeomorphism.sign_of Diffeomorphism.weight Diffeomorphism.sample_values"
RESULTS: tuple[type, ...] = (JaxFunction, TorchFunction, VectorFunction)
"""Classes of what public functions return that have no public name."""


def public_objects() -> Iterator[tuple[str, Any]]:
    """Yields the public functions and classes, and the public methods and properties of the latter that have a docstring of their own."""
    values = [(name, getattr(teg, name)) for name in teg.__all__ if name != "ArrayEvaluator"]
    values += [(f"maps.{k}", f) for k, f in vars(teg.maps).items() if inspect.isfunction(f) and f.__module__ == "teg.maps" and k[0] != "_"]
    for name, value in [*values, *((kind.__name__, kind) for kind in RESULTS)]:
        if isinstance(value, ModuleType) or (inspect.isclass(value) and issubclass(value, Exception)):
            continue  # tests/package/test_errors.py runs the examples of errors, which end in one
        yield name, value
        if inspect.isclass(value):
            for key, member in vars(value).items():
                if key[0] != "_" and (inspect.isfunction(member) or (isinstance(member, property) and inspect.getdoc(member))):
                    yield f"{name}.{key}", member


OBJECTS = dict(public_objects())
FUNCTIONS = {name: value for name, value in OBJECTS.items() if inspect.isfunction(value)}


def examples_in(docstring: str) -> list[str]:
    """The paragraphs of a docstring that are programs."""
    programs = []
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(docstring))[1:]:
        try:
            tree = ast.parse(textwrap.dedent(paragraph))
        except SyntaxError:
            continue
        if any(isinstance(node, ast.Call | ast.Attribute) for node in ast.walk(tree)):
            programs.append(textwrap.dedent(paragraph))
    return programs


def assert_value(value: Any, comment: str) -> None:
    """Compares the value of a line with the comment behind it: "value" or "value: why", numbers to the tolerance of an integral."""
    number = re.match(r"(-?[\d.e-]+): ", comment)
    promised = number[1] if number else comment
    if not isinstance(value, str):
        numbers = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
        assert re.sub(numbers, "#", repr(value)) == re.sub(numbers, "#", promised)
        pairs = zip(re.findall(numbers, repr(value)), re.findall(numbers, promised), strict=True)
        assert all(float(a) == pytest.approx(float(b), rel=1e-9, abs=1e-12) for a, b in pairs)
    else:
        assert promised in (value, repr(value))


@pytest.fixture(scope="module")
def taken_for_granted() -> dict[str, Any]:
    """The names that the page of the reference defines for all examples."""
    (program,) = re.findall(r"```python\n(.*?)```", REFERENCE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(program, names)
    return names


@pytest.mark.parametrize("name", OBJECTS)
def test_the_example_of_a_docstring_runs_and_gives_what_it_says(name: str, taken_for_granted: dict[str, Any]) -> None:
    programs = examples_in(inspect.getdoc(OBJECTS[name]) or "")
    assert programs, f"{name} has no example"
    names = {**taken_for_granted, "functions": teg.scipy_function(taken_for_granted["e"], [teg.param("t"), teg.param("a")])}
    for code in programs:
        for package in set(re.findall(r"(?<![a-z])(jax|torch|scipy|sympy)(?=\.|\(|_function)", code)):
            pytest.importorskip("scipy.optimize" if package == "scipy" else package)
            names[package] = sys.modules[package]
        for line in ast.parse(code).body:
            written = "\n".join(code.splitlines()[line.lineno - 1 : line.end_lineno])
            comment = re.search(r"  # (.+)$", written)
            if isinstance(line, ast.Expr) and comment:
                assert_value(eval(ast.unparse(line), names), comment[1])
            else:
                exec(ast.unparse(line), names)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_docstring_says_what_is_returned_and_raised(name: str) -> None:
    text = inspect.getdoc(FUNCTIONS[name]) or ""
    assert text.startswith(("Returns ", "Checks ")), name
    if not name.startswith(("maps.", "VectorFunction.")) and name not in f"{NUMBERS} {CANNOT_FAIL}".split():
        assert re.search(r"\bRaises\s", text)
