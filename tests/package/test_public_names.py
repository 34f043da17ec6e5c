"""The names of the package: what `dir` and completion show, and that each of them is what it says."""

from __future__ import annotations

import ast
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import teg
from teg.ir.foreign_names import OTHER_NAMES, WRITTEN


def test_dir_shows_the_public_names_and_nothing_else() -> None:
    assert dir(teg) == sorted({*teg.__all__, "errors", "maps", "__version__"})


def test_dir_is_the_same_before_and_after_a_program_was_compiled() -> None:
    program = "import teg; before = dir(teg); teg.compile(teg.param('t')); "
    program += "import teg.report.explain, teg.interop.jax; print(before == dir(teg))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "True"


@pytest.mark.parametrize("name", teg.__all__)
def test_a_public_name_is_there_and_hides_no_module(name: str) -> None:
    submodules = {module.name for module in pkgutil.iter_modules(teg.__path__)}
    assert (name in submodules) == isinstance(getattr(teg, name), ModuleType)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'integrate'"):
        teg.integrate  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("name", OTHER_NAMES)
def test_a_name_of_another_package_leads_to_ours(name: str) -> None:
    assert name not in teg.__all__
    assert all(ours in teg.__all__ for ours in re.findall(r"(?<=teg\.)\w+", "teg." + OTHER_NAMES[name]))
    with pytest.raises(AttributeError, match=re.escape(f"; there is teg.{OTHER_NAMES[name]}")):
        getattr(teg, name)


@pytest.mark.parametrize("name", WRITTEN)
def test_a_name_of_another_package_leads_to_what_is_written_here(name: str) -> None:
    assert name not in {*teg.__all__, *OTHER_NAMES}
    assert all(ours in teg.__all__ for ours in re.findall(r"(?<=teg\.)\w+", WRITTEN[name]))
    with pytest.raises(AttributeError, match=re.escape(f"; write {WRITTEN[name]}")):
        getattr(teg, name)


def test_type_checkers_see_the_names_that_are_loaded_on_first_use() -> None:
    module = ast.parse(Path(str(teg.__file__)).read_text(encoding="utf-8"))
    guarded = next(n for n in module.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    imports = [n for n in guarded.body if isinstance(n, ast.ImportFrom) and n.module != "teg"]
    assert {str(n.module): tuple(alias.name for alias in n.names) for n in imports} == teg._LOADED_ON_FIRST_USE
