"""What every demonstration needs around its computation: packages, a backend, a folder, a progress bar, a report."""

from __future__ import annotations

import json
import os
import platform
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata, util
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from teg.errors import CompilerError, InputError, MissingPackageError

REPORTED = ("teg", "numpy", "scipy", "jax", "optax", "pillow", "scikit-image", "matplotlib")


def require_packages(demonstration: str, packages: Mapping[str, str], progress: bool, extra: str = "demo") -> None:
    """Raise MissingPackageError unless all can be imported; `packages` is import name -> name to install, `extra` has them all."""
    wanted = [k for k in packages if k != "tqdm" or progress]
    missing = [packages[k] for k in wanted if util.find_spec(k) is None]
    if missing:
        raise MissingPackageError(f"the {demonstration} needs {', '.join(missing)}", None, f'pip install "teg[{extra}]"')


def default_backend() -> str:
    """ "c" if there is a C compiler, else "numpy"."""
    from teg.backends.c.build import find_compiler

    try:
        find_compiler()
    except CompilerError:
        return "numpy"
    return "c"


def result_folder(path: Path) -> Path:
    """The folder, made if need be. Raises InputError if it cannot be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=path).close()
    except OSError as problem:
        raise InputError(f"cannot write to {str(path)!r}", None, f"{problem.strerror}; name another folder") from None
    return path


def write_report(path: Path, report: Mapping[str, Any]) -> None:
    """Write a report as JSON, whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(partial, path)


@contextmanager
def progress_bar(shown: bool, total: int, done: int, label: str = "") -> Iterator[Any]:
    """A bar on the standard error, or None."""
    if not shown:
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, initial=done, desc=label or None, unit="step", file=sys.stderr, dynamic_ncols=True) as bar:
        yield bar


def ratio(end: float, start: float) -> float:
    """end / start, 1 where nothing was to be gained."""
    return end / start if start > 0 else 1.0


def demo_command(name: str, photo: str | None, values: Mapping[str, object], out: str | Path, *flags: str) -> str:
    """The command line that repeats a demonstration: its photo, a value for each option, and flags."""
    words = ["teg", "demo", name, *([photo] if photo else [])]
    for option, value in values.items():
        words += ["--" + option.replace("_", "-"), str(value)]
    return shlex.join([*words, *flags, "-o", str(out)])


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that take part."""
    found = {"python": platform.python_version()}
    for package in REPORTED:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def machine() -> dict[str, Any]:
    """What the run ran on."""
    return {"platform": platform.platform(), "processors": os.cpu_count()}
