"""Common parts of the demonstrations: packages, a backend, a folder, a progress bar, a report."""

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
    """Raises MissingPackageError unless all packages can be imported.

    `packages` maps import names to names to install; `extra` is the option of this package that installs them all.
    """
    wanted = [k for k in packages if k != "tqdm" or progress]
    missing = [packages[k] for k in wanted if util.find_spec(k) is None]
    if missing:
        raise MissingPackageError(f"the {demonstration} needs {', '.join(missing)}", None, f'pip install "teg[{extra}]"')


def default_backend() -> str:
    """Returns "c" if there is a C compiler, else "numpy"."""
    from teg.backends.c.build import find_compiler

    try:
        find_compiler()
    except CompilerError:
        return "numpy"
    return "c"


def result_folder(path: Path) -> Path:
    """Returns the folder, made if it does not exist. Raises InputError if it cannot be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=path).close()
    except OSError as problem:
        raise InputError(f"cannot write to {str(path)!r}", None, f"{problem.strerror}; name another folder") from None
    return path


def write_report(path: Path, report: Mapping[str, Any]) -> None:
    """Writes a report as JSON, whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(partial, path)


@contextmanager
def progress_bar(shown: bool, total: int, done: int, label: str = "") -> Iterator[Any]:
    """Yields a bar on the standard error, or None."""
    if not shown:
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, initial=done, desc=label or None, unit="step", file=sys.stderr, dynamic_ncols=True) as bar:
        yield bar


def ratio(end: float, start: float) -> float:
    """Returns end / start; 1 if start is 0."""
    return end / start if start > 0 else 1.0


def demo_command(name: str, photo: str | None, values: Mapping[str, object], out: str | Path, *flags: str) -> str:
    """Returns the command line that repeats a demonstration: its photo, a value for each option, and flags."""
    words = ["teg", "demo", name, *([photo] if photo else [])]
    for option, value in values.items():
        words += ["--" + option.replace("_", "-"), str(value)]
    return shlex.join([*words, *flags, "-o", str(out)])


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the packages used."""
    installed = {"python": platform.python_version()}
    for package in REPORTED:
        try:
            installed[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            installed[package] = "not installed"
    return installed


def machine() -> dict[str, Any]:
    """Returns a description of the machine."""
    return {"platform": platform.platform(), "processors": os.cpu_count()}
