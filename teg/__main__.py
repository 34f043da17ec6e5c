"""The command line: `teg demo`, `teg chart`, `teg report`, `teg explain`, `teg compile`, `teg cache`."""

from __future__ import annotations

import argparse
import json
import os
import runpy
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, redirect_stdout
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

import teg
from teg.analysis.settings import DEFAULT_TOL
from teg.errors import AccuracyError, InputError, TegError
from teg.evaluator.options import DTYPES
from teg.examples.commands import add_demos
from teg.ir.expr import Expr
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["CommandParser"]

MEGABYTE = 10**6
FAILED, NOT_CONVERGED, INTERRUPTED = 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code: 0, 2 for a mistake of the user, 3 if an integral did not converge, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        _never_fail_on_a_character(stream)
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
        return code
    except TegError as problem:
        print(f"teg: error: {problem}", file=sys.stderr)
        return NOT_CONVERGED if isinstance(problem, AccuracyError) else FAILED
    except KeyboardInterrupt:
        print("teg: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # `teg explain FILE | head`
        _close_output()
        return 1
    except OSError as problem:  # a full disk
        _close_output()
        print(f"teg: error: cannot write the output: {problem.strerror or problem}", file=sys.stderr)
        return FAILED


def _close_output() -> None:
    """Sends what is left of the output nowhere: its end would fail once more when Python closes it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def chart_integration(options: argparse.Namespace) -> int:
    """Error against time and against evaluations for ten regions, by all rules and by the integrators of other packages."""
    from teg.examples.charts.run import run_integration

    return _chart(options, run_integration)


def chart_stability(options: argparse.Namespace) -> int:
    """Difficult cases by all methods: right, imprecise, wrong, crashes, says it cannot."""
    from teg.examples.charts.run import run_stability

    return _chart(options, run_stability)


def chart_estimators(options: argparse.Namespace) -> int:
    """Gradients by all estimators of discontinuous derivatives: error against time and against evaluations."""
    from teg.examples.charts.run_estimators import run_estimators

    return _chart(options, run_estimators)


def chart_descents(options: argparse.Namespace) -> int:
    """Descents with each estimator of the gradient, for the same time."""
    from teg.examples.charts.run_descents import run_descents

    return _chart(options, run_descents)


def chart_lean(options: argparse.Namespace) -> int:
    """Evaluations, statements and nanoseconds of scenes of every kind beside the least known."""
    from teg.examples.charts.run_lean import run_lean

    return _chart(options, run_lean)


def _chart(options: argparse.Namespace, run: Callable[..., dict[str, Any]]) -> int:
    from teg.examples.charts.run import summary

    report = run(
        options.out,
        options.page,
        quick=options.quick,
        fresh=options.fresh,
        backend=options.backend,
        progress=not options.quiet,
    )
    print(report["summary"] if "summary" in report else summary(report))
    print(f"results in {options.out}" + (f", tables in {options.page}" if options.page else ""))
    if report["interrupted"]:
        print("interrupted: the same command goes on from here")
        return INTERRUPTED
    return 0


def list_charts(options: argparse.Namespace) -> int:
    """The charts there are."""
    for name, (chart, _) in CHARTS.items():
        print(f"{name:<12} {chart.__doc__}")
    return 0


CHARTS = {
    "integration": (chart_integration, "error against cost"),
    "stability": (chart_stability, "difficult cases"),
    "estimators": (chart_estimators, "estimators of derivatives"),
    "descents": (chart_descents, "estimators in descents"),
    "lean": (chart_lean, "cost beside the least known"),
}


def report_stability(options: argparse.Namespace) -> int:
    """Gradients of difficult cases by all estimators: right, imprecise, said in the call, by diagnose only, silently wrong, crash."""
    from teg.examples.charts.run_report import run_case, run_report

    if options.case is None:
        return _chart(options, run_report)
    print(run_case(options.case, options.backend))
    return 0


def explain(options: argparse.Namespace) -> int:
    """Print what the compiler finds in an expression: its surfaces, its integrals, the cost."""
    with redirect_stdout(sys.stderr) if options.json else nullcontext():  # what the file itself prints is no JSON
        e = load_expression(options.file)
    report = teg.explain(e, tol=options.tol, derivatives=options.derivatives)
    print(json.dumps(report.data, indent=2, ensure_ascii=False) if options.json else report)
    return 0


def compile_file(options: argparse.Namespace) -> int:
    """Write an expression with its derivatives as a C source and its header."""
    source = Path(options.out)
    if source.suffix != ".c":
        raise InputError(f"the output is named {options.out!r}", None, "a name that ends in .c; the header goes beside it")
    evaluator: Any = teg.compile(load_expression(options.file), tol=options.tol, dtype=options.dtype)
    text, header = _c_files(evaluator, source.stem, options)
    try:
        for path, content in ((source, text), (source.with_suffix(".h"), header)):
            path.write_text(content, encoding="utf-8")
    except OSError as problem:
        raise InputError(f"cannot write {options.out!r}", None, str(problem.strerror)) from None
    second = "Hessian times a direction" if isinstance(evaluator.program(0), ArrayProgram) else "Hessian"
    what = ("value", "value and gradient", f"value, gradient and {second}")[options.derivatives]
    print(f"{source} and {source.with_suffix('.h').name}: {what} of {source.stem}({', '.join(evaluator.parameters)})")
    return 0


def _c_files(evaluator: Any, name: str, options: argparse.Namespace) -> tuple[str, str]:
    """The texts of the source and its header."""
    from teg.backends.c.standalone import standalone_c

    program, names = evaluator.program(options.derivatives), evaluator.output_names(options.derivatives)
    return standalone_c(program, name, names, {"float64": "double", "float32": "float"}[options.dtype])


def show_cache(options: argparse.Namespace) -> int:
    """The folder in which compiled C is kept, and its size."""
    from teg.backends.c.cache import cache_folder, entries_of, size_limit

    folder, limit = cache_folder(), size_limit()
    print(f"{folder}: {_amount(entries_of(folder))} of at most {limit / MEGABYTE:g} MB (TEG_CACHE_DIR, TEG_CACHE_SIZE)")
    wanted = os.environ.get("TEG_CACHE_DIR")
    if wanted and not (os.path.isdir(wanted) and os.path.samefile(wanted, folder)):
        print(f"teg: TEG_CACHE_DIR, {wanted}, cannot be used: what is compiled is kept until the process ends", file=sys.stderr)
    return 0


def clear_cache(options: argparse.Namespace) -> int:
    """Remove all compiled C that is kept; it is compiled again when it is needed."""
    from teg.backends.c.cache import cache_folder, clear

    folder = cache_folder()
    print(f"{folder}: removed {_amount(clear(folder))}")
    return 0


def _amount(entries: Sequence[Any]) -> str:
    count = len(entries)
    return f"{count} compiled {'file' if count == 1 else 'files'}, {sum(entry.size for entry in entries) / MEGABYTE:.1f} MB"


def load_expression(place: str) -> Expr:
    """The expression that FILE[:NAME] names: a Python file, and a variable in it (`e`).

    The file is run, so it must be trusted. Raises InputError if there is no such file or name, or the file fails.
    """
    file, name = _split_place(place)
    path = Path(file)
    if not path.is_file():
        raise InputError(f"there is no file {file!r}", None, "FILE is a Python file that defines an expression")
    sys.path.insert(0, str(path.resolve().parent))  # its neighbours can be imported, as when it is run
    try:
        found = runpy.run_path(file, run_name="<teg>")
    except TegError:
        raise
    except SyntaxError as problem:
        raise InputError(f"{file!r} is not a Python program", None, f"line {problem.lineno}: {problem.msg}") from None
    except Exception as problem:
        raise InputError(f"{file!r} failed", None, f"{type(problem).__name__}: {problem}") from problem
    finally:
        sys.path.pop(0)
    expressions = [k for k, v in found.items() if isinstance(v, Expr) and v.children]
    hint = f"it defines {', '.join(expressions)}: write {file}:{expressions[-1]}" if expressions else "it defines no expression"
    if name not in found:
        raise InputError(f"{file!r} does not define {name!r}", None, hint)
    e = found[name]
    if not isinstance(e, Expr):
        raise InputError(f"{name!r} in {file!r} is not an expression but of type {type(e).__name__}", None, hint)
    return e


def _split_place(place: str) -> tuple[str, str]:
    file, colon, name = place.rpartition(":")
    if colon and name.isidentifier() and not Path(place).exists():
        return file, name
    return place, "e"


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line. Commands refuse unknown arguments themselves, and name the nearest flag."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Returns the options, and no unknown arguments."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            flags = [flag for action in self._actions for flag in action.option_strings]
            near = [match for word in unknown for match in get_close_matches(word.partition("=")[0], flags, 1)]
            self.error(f"unknown arguments: {' '.join(unknown)}" + (f"; is it {near[0]}?" if near else ""))
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Prints the message, and exits with the code of a mistake."""
        self.exit(FAILED, f"{self.prog}: error: {message} (hint: {self.prog} --help)\n")


def _parser() -> CommandParser:
    parser = CommandParser(prog="teg", description="A compiler for integrals over discontinuous programs, with correct derivatives.")
    parser.add_argument("--version", action="version", version=f"teg {teg.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    add_demos(commands.add_parser("demo", help="run an example").add_subparsers(required=True, metavar="NAME"))
    _add_charts(commands)
    _add_reports(commands)

    about = "a Python file, and the name of an expression in it (e)"
    show = commands.add_parser("explain", help="say what the compiler finds in an expression", description=explain.__doc__)
    show.add_argument("file", metavar="FILE[:NAME]", help=about)
    show.add_argument("--derivatives", type=int, choices=[0, 1], default=0, help="1: the gradient's interior integrals too (%(default)s)")
    show.add_argument("--tol", type=float, default=DEFAULT_TOL, help="of the integrals that are adaptive (%(default)s)")
    show.add_argument("--json", action="store_true", help="everything, unshortened, as JSON")
    show.set_defaults(run=explain)

    write = commands.add_parser("compile", help="write an expression as C", description=compile_file.__doc__)
    write.add_argument("file", metavar="FILE[:NAME]", help=about)
    write.add_argument("--target", choices=["c"], default="c", help="the language (%(default)s)")
    orders = "0: value, 1: and gradient, 2: and Hessian, of a program with arrays its product with a direction (%(default)s)"
    write.add_argument("--derivatives", type=int, choices=[0, 1, 2], default=1, help=orders)
    write.add_argument("--tol", type=float, help="of the integrals that are adaptive (1e-10, of float32 1e-6)")
    write.add_argument("--dtype", choices=DTYPES, default="float64", help="of inputs and outputs (%(default)s)")
    write.add_argument("-o", "--out", required=True, metavar="OUT.c", help="the source; its name is the function's")
    write.set_defaults(run=compile_file)

    cache = commands.add_parser("cache", help="compiled C that is kept on disk").add_subparsers(required=True, metavar="NAME")
    for name, run in (("info", show_cache), ("clear", clear_cache)):
        cache.add_parser(name, help=str(run.__doc__), description=run.__doc__).set_defaults(run=run)
    return parser


def _add_charts(commands: Commands) -> None:
    charts = commands.add_parser("chart", help="measure, beside what one would use instead", description=list_charts.__doc__)
    charts.set_defaults(run=list_charts)
    names = charts.add_subparsers(metavar="NAME")
    for name, (run, about) in CHARTS.items():
        chart = names.add_parser(name, help=about, description=run.__doc__)
        _add_measuring(chart, "out/charts")
        chart.set_defaults(run=run)


def _add_reports(commands: Commands) -> None:
    names = commands.add_parser("report", help="judge all methods on difficult cases").add_subparsers(required=True, metavar="NAME")
    about = report_stability.__doc__
    report = names.add_parser("stability", help="gradients of difficult cases by all estimators", description=about)
    report.add_argument("--case", metavar="NAME", help="this case only, with errors and notes; nothing is stored")
    _add_measuring(report, "out/report")
    report.set_defaults(run=report_stability)


def _add_measuring(chart: argparse.ArgumentParser, out: str) -> None:
    """The options of commands that measure."""
    chart.add_argument("-o", "--out", default=out, metavar="DIR", help="folder of the results (%(default)s)")
    chart.add_argument("--page", metavar="FILE.md", help="a page whose tables, between marks, are written anew")
    chart.add_argument("--quick", action="store_true", help="a few points only, in seconds")
    chart.add_argument("--fresh", action="store_true", help="measure again what DIR has already")
    chart.add_argument("--backend", choices=["numpy", "c"], help="c if there is a C compiler, else numpy")
    chart.add_argument("--quiet", action="store_true", help="no progress bar")


def _never_fail_on_a_character(stream: TextIO) -> None:
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())
