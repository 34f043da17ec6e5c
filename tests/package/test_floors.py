"""The floors of the house: what may import what, what importing costs, and that the wheel holds every package."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from teg.passes.intrinsics import STATEMENTS

ROOT = Path(__file__).resolve().parents[2]

FLOORS = (
    "teg.errors teg.numerics",
    "teg.ir teg.program",
    "teg.symbolic teg.analysis teg.language",
    "teg.passes teg.maps",
    "teg.pipeline teg.derivatives teg.backends",
    "teg.report",
    "teg.evaluator",
    "teg.interop",
    "teg teg.__main__ teg.examples",
)
"""A folder imports from lower floors and from its own floor."""

STAGES = ["normalise", "differentiate", "eliminate", "lower", "intrinsics", "program"]
"""The folders of `teg/passes`: a stage imports from earlier stages and from itself."""

OPTIONAL = ["jax", "torch", "sympy", "scipy", "matplotlib", "PIL", "skimage", "tqdm", "mpmath"]


def modules() -> dict[str, Path]:
    """Every module of the installed package, by the name it is imported by."""
    found = {}
    for folder, package in (("teg", "teg"), ("backends", "teg.backends"), ("examples", "teg.examples")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join((package, *parts))] = path
    return found


MODULES = modules()


@cache
def import_statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """The imports of a file, anywhere in it."""
    return [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Import | ast.ImportFrom)]


def packages(path: Path) -> set[str]:
    """The packages that a file imports from, anywhere in it."""
    nodes = import_statements(path)
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.split(".")[0] for name in names}


def imports(path: Path) -> set[str]:
    """The modules of teg that a file imports, anywhere in it."""
    names: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            assert node.level == 0, f"{path}: imports are absolute"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                names.add(full if full in MODULES else str(node.module))
    return {n for n in names if n.split(".")[0] == "teg"}


def floor(module: str) -> int:
    parts = module.split(".")
    package = ".".join(parts[:2])
    return next(i for i, names in enumerate(FLOORS) if package in names.split())


@pytest.mark.parametrize("module", MODULES)
def test_lower_floors_never_import_higher_ones(module: str) -> None:
    for other in imports(MODULES[module]):
        assert floor(other) <= floor(module), f"{module} imports {other}"


def test_stages_of_passes_never_import_later_ones() -> None:
    for module, path in MODULES.items():
        if module.startswith("teg.passes."):
            stage = STAGES.index(module.split(".")[2])
            for other in (o for o in imports(path) if o.startswith("teg.passes.")):
                assert STAGES.index(other.split(".")[2]) <= stage, f"{module} imports {other}"


def test_intrinsics_are_known_by_their_list_only() -> None:
    for module, path in MODULES.items():
        for other in (o for o in imports(path) if o.startswith("teg.passes.intrinsics.")):
            folder = ".".join(other.split(".")[:4])
            assert module == "teg.passes.intrinsics" or module.startswith(folder), f"{module} imports {other}"


def test_statements_of_intrinsics_are_named_by_intrinsics_only() -> None:
    """No other pass, report or evaluator asks for the class of such a statement."""
    of_intrinsics = {kind.__name__ for kind in STATEMENTS}
    assert {"Polygon", "Hyperbola"} <= of_intrinsics
    for module, path in MODULES.items():
        if module.startswith("teg.") and not module.startswith(("teg.program", "teg.backends", "teg.examples", "teg.passes.intrinsics")):
            named = {
                a.name
                for n in import_statements(path)
                if isinstance(n, ast.ImportFrom) and n.module and n.module.startswith("teg.program")
                for a in n.names
            }
            assert named.isdisjoint(of_intrinsics), module


def test_backends_know_the_lowered_program_only() -> None:
    allowed = ("teg.errors", "teg.program", "teg.numerics", "teg.backends")
    for module, path in MODULES.items():
        if module.startswith("teg.backends"):
            assert all(o.startswith(allowed) for o in imports(path)), module


def test_nodes_know_no_mathematics() -> None:
    assert imports(MODULES["teg.ir.node"]) == set()


def test_sympy_has_one_importer() -> None:
    importers = {m for m, p in MODULES.items() if "sympy" in packages(p)}
    assert importers == {"teg.symbolic.nodes"}


LOADED_BY_IMPORT = ("teg", "teg.numerics", "teg.errors", "teg.ir", "teg.language")
"""Modules and folders that `import teg` loads: what is needed to write a program down."""


def loaded_by(program: str) -> list[str]:
    """The modules that a fresh interpreter has loaded after `program`."""
    listing = f"import sys; {program}; print(*sys.modules)"
    return subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True).stdout.split()


def test_importing_loads_the_language_only() -> None:
    loaded = loaded_by("import teg")
    for module in loaded:
        if module.split(".")[0] == "teg":
            assert module == "teg" or module.startswith(LOADED_BY_IMPORT[1:]), module
    assert not set(loaded) & {*OPTIONAL, "numpy"}


def test_importing_is_quick() -> None:
    program = "import numpy, time; start = time.process_time(); import teg; print(time.process_time() - start)"
    runs = (subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout for _ in range(5))
    assert min(map(float, runs)) < 0.15  # of the processor, beside NumPy; 0.03 on a quiet machine


def test_compiling_for_numpy_loads_nothing_optional() -> None:
    program = (
        "import sys, teg; x, t = teg.var('x'), teg.param('t');"
        "f = teg.compile(teg.integral(teg.bracket(x < t), (x, 0, 1)), [t]); f.value_and_grad(t=0.5); f.explain(); f.diagnose(t=0.5);"
        f"print(*[m for m in {OPTIONAL} if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split() == []


def test_the_package_list_is_complete() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    packages = {name for name, path in MODULES.items() if path.name == "__init__.py"}
    assert set(settings["packages"]) == packages


def test_backends_are_imported_under_one_name_only() -> None:
    found = subprocess.run([sys.executable, "-c", "import backends"], capture_output=True, text=True, cwd=ROOT, check=False)
    assert found.returncode != 0
    assert "teg.backends" in found.stderr
