"""The size of functions: at most 60 lines, and at most six parameters unless users call them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINES, PARAMETERS = 60, 6

TABLES = {"teg/symbolic/reader.py builders"}
"""Long functions that are one table."""

PUBLIC = {
    "examples/bouncing_ball/run.py run_bouncing_ball",
    "examples/mesh_network/run.py run_mesh_network",
    "examples/perlin/run.py run_perlin",
    "examples/triangulation/run.py run_triangulation",
    "teg/evaluator/compile.py compile",
    "teg/interop/jax.py jax_function",
    "teg/interop/torch.py torch_function",
    "teg/maps/__init__.py cylindrical",
    "teg/maps/__init__.py spherical",
    "teg/evaluator/explain.py explain",
}
"""Functions with more parameters that users call by name."""

DOCUMENTED = {"teg/evaluator/compile.py compile"}
"""Functions whose docstrings are tables of options."""


def functions(node: ast.AST, prefix: str = "", in_class: bool = False) -> Iterator[tuple[str, int, int]]:
    """The functions below a node: the qualified name, the lines, and the parameters without `self` and `cls`."""
    for child in ast.iter_child_nodes(node):
        match child:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                names = [a.arg for a in (*child.args.posonlyargs, *child.args.args, *child.args.kwonlyargs)]
                own = names[1:] if in_class and names[:1] in (["self"], ["cls"]) else names
                yield prefix + child.name, (child.end_lineno or 0) - child.lineno + 1, len(own)
                yield from functions(child, f"{prefix}{child.name}.")
            case ast.ClassDef():
                yield from functions(child, f"{prefix}{child.name}.", True)
            case _:
                yield from functions(child, prefix, in_class)


@cache
def all_functions() -> dict[str, tuple[int, int]]:
    """Lines and parameters of every function, by file and name."""
    sizes = {}
    for folder in ("teg", "backends", "examples"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for name, lines, parameters in functions(ast.parse(path.read_text(encoding="utf-8"))):
                sizes[f"{path.relative_to(ROOT).as_posix()} {name}"] = (lines, parameters)
    return sizes


def test_functions_are_short() -> None:
    assert {name for name, (lines, _) in all_functions().items() if lines > LINES} == TABLES | DOCUMENTED


def test_internal_functions_have_few_parameters() -> None:
    assert {name for name, (_, parameters) in all_functions().items() if parameters > PARAMETERS} <= PUBLIC
