"""Applies single wrong changes to a copy of the tree, and tells which of them the quick tests notice.

    python -m tests.mutation.run [-k words] [-o README.md]

A change is killed if one of its tests fails, and has survived if all pass; before that, all these tests must pass without it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.mutation.table import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]
LINKED = {"teg/backends": "../backends", "teg/examples": "../examples"}
"""Where the packages stand in an installed project: an editable one finds those of the tree that it was installed from."""
LIMIT = 900
KILLED, PASSED = 1, 0


def copy_tree(target: Path) -> None:
    """A copy of the tree in which `import teg` finds the copy."""
    left_out = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "out", "build", "dist")
    shutil.copytree(ROOT, target, ignore=left_out, dirs_exist_ok=True)
    for place, to in LINKED.items():
        (target / place).symlink_to(to)
    show = "import teg, teg.backends.c.kernel as k; print(teg.__file__, k.__file__)"
    found = subprocess.run([sys.executable, "-c", show], cwd=target, env=environment(target), check=True, capture_output=True, text=True)
    assert all(Path(name).is_relative_to(target) for name in found.stdout.split()), found.stdout


def environment(tree: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1", "TEG_CACHE_DIR": str(tree / ".kernels")}


def outcome(tree: Path, tests: Sequence[str]) -> int:
    """The exit status of pytest on these tests, up to the first that fails; 1 too if they take longer than the limit. Quick ones alone, but
    for those of the backend for JAX, which XLA makes slow."""
    of_jax = [t for t in tests if t.startswith("tests/backends/jax/")]
    others = [t for t in tests if t not in of_jax]
    results = [_status(tree, some, marks) for some, marks in ((others, "not slow"), (of_jax, "not thorough")) if some]
    return max(results, default=PASSED)


def _status(tree: Path, tests: Sequence[str], marks: str) -> int:
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", marks, "-p", "no:cacheprovider", *tests]
    try:
        return subprocess.run(command, cwd=tree, env=environment(tree), timeout=LIMIT, capture_output=True, check=False).returncode
    except subprocess.TimeoutExpired:
        return KILLED


def judged(tree: Path, mutant: Mutant) -> str:
    """What becomes of a change; the tree is as before."""
    path = tree / mutant.file
    text = path.read_text() if path.is_file() else ""
    if text.count(mutant.old) != 1:
        return "error: the text does not stand there once"
    path.write_text(text.replace(mutant.old, mutant.new))
    try:
        status = outcome(tree, mutant.tests)
    finally:
        path.write_text(text)
    if status not in (KILLED, PASSED):
        return f"error {status}"
    return "killed" if status == KILLED else f"survived: {mutant.harmless}" if mutant.harmless else "SURVIVED"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-k", default="", help="words that a name or a file holds")
    parser.add_argument("-o", type=Path, help="a file for the table")
    options = parser.parse_args()
    chosen = [m for m in MUTANTS if options.k in m.name or options.k in m.file]
    rows = ["| change | file | outcome | s |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        copy_tree(tree)
        tests = sorted({test for m in chosen for test in m.tests})
        if outcome(tree, tests) != PASSED:
            raise SystemExit(f"without a change these do not pass: {' '.join(tests)}")
        for mutant in chosen:
            start = time.perf_counter()
            result = judged(tree, mutant)
            rows.append(f"| {mutant.name} | `{mutant.file}` | {result} | {time.perf_counter() - start:.0f} |")
            print(rows[-1], flush=True)
    if options.o:
        options.o.write_text("\n".join(rows) + "\n")
    if any("SURVIVED" in row or "error" in row for row in rows):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
