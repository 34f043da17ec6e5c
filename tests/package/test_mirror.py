"""Tests mirror the house: the test of a module is found by its name, or by this table, which says where a module is tested instead."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

BY_FEATURE = {
    "adaptive guard integrals kernel lanes pieces printer runtime": "tests/backends/numpy/test_kernel.py tests/backends/jax/test_kernel.py",
    "bends": "tests/backends/test_bends.py",
    "ellipse ellipses arcs": "tests/backends/test_ellipse.py tests/backends/test_clipped_ellipse.py",
    "hyperbola moments": "tests/backends/test_hyperbola.py",
    "poles": "tests/backends/test_poles.py",
    "polyhedron polyhedra": "tests/backends/test_polyhedron.py",
    "polygon polygons clipped": "tests/backends/test_polygon.py",
    "samples": "tests/backends/test_sampling.py tests/backends/test_sampled.py",
    "isolate": "tests/backends/numpy/test_isolate.py tests/backends/jax/test_isolate.py tests/backends/c/test_isolate.py",
    "locate roots": "tests/backends/numpy/test_locate.py tests/backends/jax/test_locate.py tests/backends/c/test_locate.py",
    "side_lines": "tests/numerics/test_side_lines.py",
    "cell_lines measured parting tiles twins arrangement": "tests/backends/numpy/test_cells.py tests/backends/shared/test_cells.py",
    "gaps": "tests/backends/test_gaps.py",
    "loops lengths ties arrays": "tests/backends/test_arrays.py tests/report/test_array_reports.py",
    "tabled": "tests/end_to_end/test_alike_terms.py",
    "error_function": "tests/numerics/test_error_function.py",
    "rules": "tests/backends/test_shared.py tests/end_to_end/test_rules.py",
}
"""Words in the names of modules of `backends/` and `teg/program/interpreter/`, and the tests of that feature, by hand-written programs in
every backend."""

ELSEWHERE = {
    "teg/analysis": {
        "break_functions": "tests/analysis/test_breaks.py",
        "bodies": "tests/ir/test_function.py",
        "critical": "tests/end_to_end/test_references.py",
        "endless": "tests/end_to_end/test_infinite_ranges.py",
        "guards": "tests/passes/lower/test_integrals.py",
        "half_angle": "tests/passes/differentiate/test_edges.py",
        "isolation": "tests/passes/lower/test_roots.py",
        "proportional": "tests/passes/normalise/test_canonicalise.py",
        "remarks": "tests/passes/test_remarks.py",
        "settings": "tests/evaluator/test_compile.py",
        "sharp": "tests/passes/lower/test_guarded.py",
        "staircase": "tests/passes/normalise/test_steps.py",
    },
    "teg/evaluator": {
        "accuracy": "tests/evaluator/test_evaluator.py",
        "arguments": "tests/evaluator/test_evaluator.py",
        "counting": "tests/passes/normalise/test_padded.py",
        "derivation": "tests/evaluator/test_evaluator.py",
        "explain": "tests/report/test_explain.py",
        "framework": "tests/interop/test_jax.py",
        "kept": "tests/evaluator/test_runs.py",
        "kernels": "tests/evaluator/test_evaluator.py",
        "lengths": "tests/evaluator/test_evaluator.py",
        "options": "tests/evaluator/test_compile.py",
        "plan": "tests/evaluator/test_evaluator.py",
        "tabled": "tests/end_to_end/test_alike_terms.py",
        "wanted": "tests/evaluator/test_timing.py",
    },
    "teg/interop": {"pytrees": "tests/interop/test_jax_arguments.py"},
    "teg/ir": {
        "cells": "tests/ir/test_arrays.py",
        "index": "tests/ir/test_integers_and_masks.py",
        "integral": "tests/ir/test_expr.py",
        "operands": "tests/ir/test_expr.py",
        "partition": "tests/ir/test_choices.py",
        "tables": "tests/passes/normalise/test_tables.py",
        "uncovered": "tests/passes/differentiate/test_edges.py",
    },
    "teg/language": {"programs": "tests/ir/test_expr.py"},
    "teg/maps": {
        "checks": "tests/maps/test_diffeomorphism.py",
        "identities": "tests/maps/test_diffeomorphism.py",
        "images": "tests/maps/test_diffeomorphism.py",
        "verification": "tests/maps/test_diffeomorphism.py",
    },
    "teg/numerics": {
        "cells": "tests/numerics/test_cell_integrals.py",
        "measured": "tests/numerics/test_cell_integrals.py",
        "sobol": "tests/backends/test_sampling.py",
    },
    "teg/passes/differentiate/estimators": dict.fromkeys(
        ("coverage", "differences", "estimator", "exact", "ignore", "nests", "smooth", "spsa", "warp", "warp_blur"),
        "tests/passes/differentiate/test_estimators.py",
    )
    | {"aggregate": "tests/passes/differentiate/test_aggregate.py"},
    "teg/passes/eliminate": {
        "affine": "tests/passes/eliminate/test_families.py",
        "barycentric": "tests/passes/eliminate/test_vertices.py",
        "bilinear": "tests/passes/eliminate/test_charts.py",
        "clip": "tests/passes/eliminate/test_edge_mc.py",
        "crossings": "tests/passes/eliminate/test_charts.py",
        "edge_hierarchy": "tests/passes/eliminate/test_edge_mc.py",
    },
    "teg/passes/intrinsics/ellipse": dict.fromkeys(("errors", "lowering", "match"), "tests/backends/test_intrinsics.py"),
    "teg/passes/intrinsics/hyperbola": dict.fromkeys(("errors", "lowering", "match"), "tests/backends/test_intrinsics.py"),
    "teg/passes/intrinsics/pole": {"match": "tests/backends/test_poles.py"},
    "teg/passes/intrinsics/polygon": {
        "adjoints": "tests/passes/intrinsics/test_adjoints.py",
        "errors": "tests/passes/program/test_errors.py",
        "lowering": "tests/passes/intrinsics/test_polygon.py",
        "match": "tests/passes/intrinsics/test_polygon.py",
        "polynomials": "tests/passes/intrinsics/test_adjoints.py",
    },
    "teg/passes/differentiate": {"gaps": "tests/passes/differentiate/test_edges.py"},
    "teg/passes/lower": dict.fromkeys(("emit", "intrinsic", "levels", "refute", "rounding"), "tests/passes/lower/test_integrals.py")
    | {
        "cut": "tests/ir/test_arrays.py",
        "linear": "tests/passes/normalise/test_tables.py",
        "loops": "tests/ir/test_arrays.py",
        "nest": "tests/ir/test_arrays.py",
        "rules": "tests/end_to_end/test_rules.py",
    },
    "teg/passes/normalise": {
        "alike": "tests/end_to_end/test_alike_terms.py",
        "choices": "tests/ir/test_choices.py",
        "denominators": "tests/passes/normalise/test_canonicalise.py",
        "extremes": "tests/end_to_end/test_alike_terms.py",
        "inline": "tests/ir/test_function.py",
        "rows": "tests/end_to_end/test_alike_terms.py",
        "uncovered": "tests/passes/differentiate/test_edges.py",
    },
    "teg/passes/program": {
        "errors_in_loops": "tests/report/test_array_reports.py",
        "link": "tests/backends/test_function.py",
        "propagation": "tests/passes/program/test_errors.py",
        "sink": "tests/passes/intrinsics/test_polygon.py",
    },
    "teg": {"errors": "tests/package/test_errors.py", "pipeline": "tests/package/test_pipeline.py"},
    "teg/program": {
        "arrays": "tests/program/test_interpreter.py",
        "limits": "tests/program/test_interpreter.py",
        "rules": "tests/program/test_interpreter.py",
        "statements": "tests/program/test_fields.py",
        "summed": "tests/passes/intrinsics/test_adjoints.py",
        "tabled": "tests/end_to_end/test_alike_terms.py",
    },
    "teg/program/interpreter": {
        "counts": "tests/program/test_counts.py",
        "integrate": "tests/program/test_interpreter.py",
        "machine": "tests/program/test_interpreter.py",
        "nodes": "tests/program/test_interpreter_nodes.py",
    },
    "teg/report": {
        "explanation": "tests/report/test_explain.py",
        "integrals": "tests/report/test_explain.py",
        "inventory": "tests/report/test_explain.py",
        "loop_watch": "tests/report/test_array_reports.py",
        "number_watch": "tests/report/test_diagnose.py",
        "parameter_steps": "tests/report/test_diagnose.py",
    },
    "teg/symbolic": {"nodes": "tests/symbolic/test_reader_and_writer.py"},
    "backends": {"branches": "tests/passes/program/test_group.py"},
    "backends/c": {
        "batch": "tests/backends/c/test_evaluator.py",
        "bodies": "tests/backends/test_function.py",
        "cache": "tests/backends/c/test_build.py",
        "calls": "tests/backends/c/test_frame.py",
        "chunks": "tests/backends/c/test_threads.py",
        "functions": "tests/backends/test_function.py",
        "iterations": "tests/backends/c/test_pixels.py",
        "printer": "tests/backends/c/test_kernel.py",
        "integrals": "tests/backends/c/test_kernel.py",
        "lane_functions": "tests/backends/c/test_lanes.py",
        "routines": "tests/backends/c/test_kernel.py",
        "unit": "tests/backends/c/test_kernel.py",
        "quadrature": "tests/backends/c/test_kernel.py",
        "steps": "tests/backends/test_arrays.py",
        "straights": "tests/backends/c/test_lanes.py",
        "tabled_kernel": "tests/end_to_end/test_alike_terms.py",
        "team": "tests/backends/c/test_threads.py",
        "text": "tests/backends/c/test_names.py",
        "waiting": "tests/backends/c/test_queues.py",
    },
    "backends/jax": {
        "derivative": "tests/interop/test_jax.py",
        "matching": "tests/backends/jax/test_alike.py",
        "precision": "tests/interop/test_jax.py",
        "printer": "tests/backends/jax/test_kernel.py",
    },
    "backends/torch": {"derivative": "tests/interop/test_torch.py", "graphs": "tests/interop/test_torch.py"},
}
"""By folder: modules without a test of their own name, and the test that is theirs."""


def own_test(module: Path) -> Path:
    """Returns the place of the test of a module by its name."""
    folders = module.parts[1:-1] if module.parts[0] == "teg" else module.parts[:-1]
    return Path("tests", *folders, f"test_{module.name}")


def elsewhere(module: Path) -> list[str]:
    """Returns the tests that the tables name for a module."""
    listed = ELSEWHERE.get(module.parent.as_posix(), {}).get(module.stem)
    if listed is not None:
        return [listed]
    is_of_a_feature = module.parts[0] == "backends" or module.parent.name == "interpreter"
    return [test for words, tests in BY_FEATURE.items() if is_of_a_feature and module.stem in words.split() for test in tests.split()]


MODULES = [
    p.relative_to(ROOT) for folder in ("teg", "backends") for p in sorted((ROOT / folder).rglob("*.py")) if not p.stem.startswith("__")
]


def test_every_module_has_its_test() -> None:
    assert [str(m) for m in MODULES if not (ROOT / own_test(m)).is_file() and not elsewhere(m)] == []


def test_the_table_names_tests_that_are_there_and_modules_without_their_own() -> None:
    named = {test for m in MODULES for test in elsewhere(m)}
    assert [test for test in named if not (ROOT / test).is_file()] == []
    listed = [Path(folder, f"{name}.py") for folder, names in ELSEWHERE.items() for name in names]
    assert [str(m) for m in listed if m not in MODULES or (ROOT / own_test(m)).is_file()] == []


def test_every_test_asserts_something() -> None:
    """A test file without an assertion tests nothing."""
    for path in (ROOT / "tests").rglob("test_*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        checks = [
            n
            for n in nodes
            if isinstance(n, ast.Assert)
            or (isinstance(n, ast.Attribute) and (n.attr.startswith("assert_") or n.attr in ("raises", "fail", "warns")))
        ]
        calls = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        assert checks or any(name.startswith(("check", "assert")) for name in calls), path
