"""Common parts of the demonstrations: packages, a backend, a folder, a progress bar, a report."""

from __future__ import annotations

import json
import os
import platform
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata, util
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from teg.errors import InputError, MissingPackageError
from teg.examples.animation import can_write_video
from teg.examples.page import write_page
from teg.examples.replay import Keep, OfVector

REPORTED = ("teg-compiler", "numpy", "scipy", "jax", "optax", "pillow", "scikit-image", "matplotlib")


def require_packages(demonstration: str, packages: Mapping[str, str], progress: bool, extra: str = "demo") -> None:
    """Raises MissingPackageError unless all packages can be imported.

    `packages` maps import names to names to install; `extra` is the option of this package that installs them all.
    """
    wanted = [k for k in packages if k != "tqdm" or progress]
    missing = [packages[k] for k in wanted if util.find_spec(k) is None]
    if missing:
        raise MissingPackageError(f"the {demonstration} needs {', '.join(missing)}", None, f'pip install "teg-compiler[{extra}]"')


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
def progress_bar(shown: bool, total: int | None, done: int, label: str = "", unit: str = "step") -> Iterator[Any]:
    """Yields a bar on the standard error, or None if it is not a terminal. Without a total it counts."""
    if not shown or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, initial=done, desc=label or None, unit=unit, file=sys.stderr, dynamic_ncols=True) as bar:
        yield bar


@contextmanager
def evaluations_shown(shown: bool, keep: Keep, label: str) -> Iterator[Keep]:
    """Yields `keep` with a bar that counts the evaluations of all functions, and shows the first number of the last result."""
    with progress_bar(shown, None, 0, label, " evaluations") as bar:

        def counted(name: str, function: OfVector) -> OfVector:
            kept = keep(name, function)

            def call(point: Any) -> Any:
                values = kept(point)
                bar.update()
                bar.set_postfix_str(f"{name} {values.flat[0]:.5g}")
                return values

            return call

        yield keep if bar is None else counted


def ratio(end: float, start: float) -> float:
    """Returns end / start; 1 if start is 0."""
    return end / start if start > 0 else 1.0


def finish(folder: Path, demo: str, settings: Mapping[str, Any], report: Mapping[str, Any]) -> dict[str, Any]:
    """Completes the report of a run, writes it as run.json and index.html, and returns it.

    `report` has the lines of its "summary", the names of its "pictures" in the folder, the best first, whether it was "interrupted",
    and its "failure", empty for a success.
    """
    pictures, films = ([str(folder / name) for name in names] for names in (report["pictures"], _films(report["pictures"])))
    whole = {"demo": demo, "interrupted": False, "failure": "", **report, "pictures": pictures, "films": films}
    whole |= {"options": dict(settings), "command": demo_command(demo, settings), "versions": versions(), "machine": machine()}
    write_report(folder / "run.json", whole)
    write_page(folder / "index.html", whole)
    return whole


def _films(pictures: Sequence[str]) -> list[str]:
    """Returns the names of the MP4 files that stand beside animations."""
    return [str(Path(name).with_suffix(".mp4")) for name in pictures if name.endswith(".gif")] if can_write_video() else []


def demo_command(name: str, settings: Mapping[str, Any]) -> str:
    """Returns the command line that repeats a demonstration."""
    words = ["teg", "demo", name]
    for option, value in settings.items():
        flag = "--" + option.replace("_", "-")
        if option == "photo":
            words += [value] if value else []
        elif value is True:
            words += [flag] if option != "resume" else []
        elif value is not None and value is not False:
            words += [f"{flag}={value}"] if str(value).startswith("-") else [flag, str(value)]
    return shlex.join(words)


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
