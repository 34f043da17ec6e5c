"""The floors of the house: what may import what, what importing costs, and that the wheel holds every package."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

FLOORS: tuple[frozenset[str], ...] = tuple(
    frozenset(names.split())
    for names in (
        "teg.errors teg.program teg.quadrature teg.branches teg.sampling teg.explanation",
        "teg.node teg.accuracy teg.array_program teg.liveness",
        "teg.expr",
        "teg.index",
        "teg.integral teg.arrays",
        "teg.function",
        "teg.traverse teg.calculus teg.dump teg.latex teg.verify teg.polynomial teg.extents",
        "teg.field_polynomials",
        "teg.coincidence",
        "teg.build teg.roots teg.surfaces teg.nest teg.places teg.intervals teg.kinks teg.sympy_nodes teg.tails teg.cells",
        "teg.antiderivative teg.singularities",
        "teg.bodies teg.isolation teg.staircase teg.critical teg.identities teg.numerics teg.sympy_writer teg.sympy_reader",
        "teg.symbolic teg.verification teg.integration teg.sharp",
        "teg.diffeomorphism",
        "teg.images teg.coverage teg.maps",
        "teg.passes",
        "teg.linking",
        "teg.pipeline teg.array_pipeline teg.array_schedule teg.array_errors",
        "teg.derivatives teg.derivation",
        "teg.backends",
        "teg.inventory",
        "teg.array_explain",
        "teg.diagnose teg.explain teg.options teg.arguments",
        "teg.array_reports teg.array_diagnose teg.array_coverage teg.derivative_programs",
        "teg.array_compiled",
        "teg.array_arguments",
        "teg.array_evaluator",
        "teg.compile teg.framework_function",
        "teg.derivative_kernels",
        "teg.check teg.scipy_function teg.jax_function teg.torch_function",
        "teg",
        "teg.examples",
        "teg.__main__",
    )
)
"""A file imports from lower floors only; packages stand on one floor whole."""

PASSES_THAT_USE_ANOTHER = {
    "adjoint": {"jumps", "differentiate"},
    "affine": {"barycentric", "demand", "vertices"},
    "at_roots": {"emit"},
    "barycentric": {"vertices"},
    "atoms": {"jumps"},
    "differentiate": {"jumps", "sift"},
    "emit": {"breaks"},
    "estimators.ignore": {"sift"},
    "reparameterize": {
        "affine",
        "bilinear",
        "hyperbola",
        "sift",
        "univariate",
        "charts",
        "implicit",
        "steep",
        "user",
    },  # the list of families
    "sampled": {"at_roots", "emit"},
    "emptiness": {"demand"},
    "guarded": {"curved", "emit"},
    "clipped": {"barycentric", "demand", "emit", "polygon", "sampled", "vertices"},
    "curved": {"clipped", "emit", "hyperbola"},
    "schedule": {"at_roots", "breaks", "demand", "emit", "emptiness", "guarded", "sampled"},
    "steep": {"affine", "implicit"},
    "steps": {"jumps"},
}
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


def packages(path: Path) -> set[str]:
    """The packages that a file imports from, anywhere in it."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.split(".")[0] for name in names}


def imports(path: Path) -> set[str]:
    """The modules of teg that a file imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                names.add(full if full in MODULES else str(node.module))
    return {n for n in names if n.split(".")[0] == "teg"}


def floor(module: str) -> int:
    package = next((p for p in ("teg.passes", "teg.backends", "teg.examples") if module == p or module.startswith(p + ".")), module)
    for i, names in enumerate(FLOORS):
        if package in names:
            return i
    raise AssertionError(f"{module} stands on no floor: add it to FLOORS in {Path(__file__).name}")


@pytest.mark.parametrize("module", MODULES)
def test_lower_floors_never_import_higher_ones(module: str) -> None:
    mine = floor(module)
    for other in imports(MODULES[module]):
        same_package = any(module.startswith(p) and other.startswith(p) for p in ("teg.passes", "teg.backends", "teg.examples"))
        assert floor(other) < mine or same_package, f"{module} imports {other}"


def test_passes_never_import_each_other() -> None:
    used: dict[str, set[str]] = {}
    for module, path in MODULES.items():
        if module.startswith("teg.passes."):
            others = {o.removeprefix("teg.passes.") for o in imports(path) if o.startswith("teg.passes.")}
            if others:
                used[module.removeprefix("teg.passes.")] = others
    for name, others in used.items():
        assert others <= PASSES_THAT_USE_ANOTHER.get(name, set()), f"{name} imports {others}"


def test_backends_know_the_scheduled_program_only() -> None:
    allowed = {
        "teg.errors",
        "teg.program",
        "teg.liveness",
        "teg.array_program",
        "teg.quadrature",
        "teg.branches",
        "teg.sampling",
        "teg.backends",
    }
    for module, path in MODULES.items():
        if module.startswith("teg.backends"):
            assert {o for o in imports(path) if not o.startswith("teg.backends")} <= allowed, module


def test_nodes_know_no_mathematics() -> None:
    assert imports(MODULES["teg.node"]) == set()


def test_sympy_has_one_importer() -> None:
    importers = {m for m, p in MODULES.items() if "sympy" in packages(p)}
    assert importers == {"teg.sympy_nodes"}


def test_importing_is_quick_and_loads_nothing_optional() -> None:
    program = (
        "import sys, time; start = time.process_time(); import teg; took = time.process_time() - start;"
        f"print(took, *[m for m in {OPTIONAL} if m in sys.modules])"
    )
    times = []
    for _ in range(5):
        took, *loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
        assert loaded == []
        times.append(float(took))
    assert min(times) < 0.5  # of the processor; 0.2 on a quiet machine, which the bench holds


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
