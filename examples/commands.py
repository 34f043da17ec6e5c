"""The command line of the demonstrations: `teg demo NAME`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from teg.errors import AccuracyError, InputError, TegError
from teg.examples.animation import NO_VIDEO
from teg.examples.options import DEMOS, OPTIONS, SMOOTH_HELP, Demo, resolved

BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 2, 3, 130
ABSENT: Any = argparse.SUPPRESS
DEFAULT_BACKEND = "c if there is a C compiler, else numpy"


def add_demos(demos: argparse._SubParsersAction[Any]) -> None:
    """Adds a parser for each demonstration. Values that are not given are absent, so that --fast and --repeat can fill them in."""
    for name, demo in DEMOS.items():
        fast = ", ".join(f"{_flag(k)} {v}" for k, v in demo.fast.items())
        about = f"{demo.about[0].upper()}{demo.about[1:]}. {demo.help.replace('%', '%%')}"
        parser = demos.add_parser(name, help=demo.about, description=about, argument_default=ABSENT)
        if demo.photo:
            parser.add_argument("photo", nargs="?", metavar="PHOTO", help=f"any file that Pillow reads (scikit-image's {demo.photo})")
        for option, value in demo.defaults.items():
            _add(parser, option, value, demo)
        parser.add_argument("-o", "--out", metavar="DIR", help=f"folder of the results (out/{name})")
        parser.add_argument("--fast", action="store_true", help=f"in seconds: {fast}" if fast else "the same: it takes seconds")
        parser.add_argument("--repeat", metavar="RUN.json", help="the options of an earlier run, from its run.json")
        parser.add_argument("--quiet", action="store_true", help="no progress bar (there is none in files and pipes anyway)")
        parser.set_defaults(run=lambda options, name=name: run_demo(name, vars(options)))


def _add(parser: argparse.ArgumentParser, name: str, value: Any, demo: Demo) -> None:
    option = OPTIONS[name]
    if option.kind is bool:
        parser.add_argument(_flag(name), action="store_true", help=option.help)
        return
    choices = {"backend": demo.backends, "discontinuities": demo.treatments}.get(name, option.choices)
    absent = demo.absent.get(name) or (DEFAULT_BACKEND if name == "backend" else "")
    default = f" ({absent})".replace(" ()", "") if value is None else f" ({value})"
    more = SMOOTH_HELP if name == "discontinuities" and "smooth" in demo.treatments else ""
    parser.add_argument(
        _flag(name),
        type=_choice if name == "discontinuities" else option.kind,
        choices=choices or None,
        metavar=option.metavar or None,
        help=option.help.replace("%", "%%") + more + default,
    )


def _choice(word: str) -> str:
    return "exact" if word == "sift" else word


def run_demo(name: str, options: Mapping[str, Any]) -> int:
    """Runs a demonstration and prints what came out and where it is; returns the exit code. A mistake is one line."""
    given = {k: v for k, v in options.items() if k not in ("run", "fast", "repeat", "quiet")}
    try:
        earlier = _earlier_options(name, Path(options["repeat"])) if "repeat" in options else {}
        settings = resolved(name, earlier | given, fast="fast" in options)
        if settings["backend"] == "jax":
            os.environ.setdefault("JAX_ENABLE_X64", "1")
        print(f"backend: {settings['backend']}", flush=True)
        report = DEMOS[name].run(settings, progress="quiet" not in options)
    except TegError as problem:
        hint = f" (hint: {problem.hint})" if problem.hint else ""
        print(f"teg: error: {' '.join((problem.what + hint).split())}", file=sys.stderr)
        return NOT_CONVERGED if isinstance(problem, AccuracyError) else BAD_INPUT
    except OSError as problem:
        print(f"teg: error: {problem.filename or 'the results cannot be written'}: {problem.strerror or problem}", file=sys.stderr)
        return BAD_INPUT
    for line in report["summary"]:
        print(line)
    print("pictures: " + " ".join([*report["pictures"], *report["films"]]))
    if not report["films"] and any(picture.endswith(".gif") for picture in report["pictures"]):
        print(NO_VIDEO)
    print(f"page: {Path(settings['out']) / 'index.html'}")
    if report["interrupted"]:
        print("interrupted" + (": the same command with --resume goes on from here" if "resume" in settings else ""))
        return INTERRUPTED
    if report["failure"]:
        print(f"teg: did not converge: {report['failure']}", file=sys.stderr)
        return NOT_CONVERGED
    return 0


def _earlier_options(name: str, path: Path) -> dict[str, Any]:
    """Returns the options of an earlier run. Raises InputError if the file has none, or is of another demonstration."""
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        demo, options = report["demo"], dict(report["options"])
    except OSError as problem:
        raise InputError(f"cannot read {str(path)!r}", None, str(problem.strerror)) from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{str(path)!r} is not the report of a demo", None, "name the run.json that a demo wrote") from None
    if demo != name:
        raise InputError(f"{str(path)!r} is of the demo {demo}", None, f"teg demo {demo} --repeat {path}")
    return {k: v for k, v in options.items() if k not in ("resume", "out")}


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
