"""What a single wrong change is, and the tests that many of them name."""

from __future__ import annotations

from typing import NamedTuple

SMALL = "tests/end_to_end/test_small_errors.py"
REFERENCES = "tests/end_to_end/test_references.py"
NUMPY, C, JAX = (f"{REFERENCES}::test_{backend}" for backend in ("numpy", "c", "jax"))


class Mutant(NamedTuple):
    """A change of one text, which stands once in its file; `harmless` says why no result depends on it, where none does."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    harmless: str = ""


def mutants(file: str, tests: tuple[str, ...], *changes: tuple[str, str, str]) -> list[Mutant]:
    """Changes of one file that the same tests must notice: name, text before and text after."""
    return [Mutant(name, file, old, new, tests) for name, old, new in changes]
