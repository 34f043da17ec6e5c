"""Odd and hostile names of parameters: in C they are comments at most, and harmless there."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import teg
from teg.__main__ import main
from teg.backends.c.standalone import standalone_c
from teg.backends.c.text import HARMLESS, harmless
from teg.ir.arrays import Array
from teg.ir.index import IndexArray
from teg.language.programs import param_of_any_name
from tests.backends.c_checks import STRICT, _compile, in_c

pytestmark = in_c
NAMES = [
    "x; rm -rf", '"x; rm -rf ~"', "`touch broken`", "$(touch broken)", "int", "double", "main", "p0", "w", "element", "teg_kernel",
    "NAN", "λ", "变量", "\u202e\u2066", "\U0001f600", "é", "a\nb", "a\r\n#error broken", "*/", "*/ #error broken /*", "/*", "//", "\\",
    "a\\\n#error", "??/", "??/\n#error broken", "'", '"', "%s%n", "{", "}", "#define double int", "a" * 10_000, "*/" * 5_000,
    "λ" * 10_000, " ", "\t", "\x7f", "__attribute__((constructor))", '_Pragma("GCC error")', "-o", "../../etc", "a b", "0", "1.5", "\ud7ff",
]  # fmt: skip
HOSTILE = re.compile(r"#error|\$|%n|\?\?|\\|rm -rf ~")


def scene(names: list[str]) -> tuple[teg.Expr, list[teg.Expr]]:
    """∫ [x < Σ names/n] Σ k·name dx, and the parameters."""
    x, parameters = teg.var("variable of its own"), [param_of_any_name(name) for name in names]
    mean = sum(parameters[1:], start=parameters[0]) / len(names)
    weighted = sum((k * p for k, p in enumerate(parameters, 1)), start=0 * x)
    return teg.integral(teg.bracket(x < mean) * weighted, (x, 0, 1)), parameters


def check_comments(text: str) -> None:
    """All of a text that users wrote is in comments, of harmless characters."""
    assert text.isascii()
    assert all(c.isprintable() or c == "\n" for c in text)
    assert not HOSTILE.search(text)
    assert max(map(len, text.splitlines())) < 200
    for comment in re.findall(r"/\*(.*?)\*/", text, re.DOTALL):
        assert "/*" not in comment
    outside = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    for word in ("constructor", "_Pragma", "broken", "touch", "etc", "rm "):
        assert word not in outside


def test_harmless() -> None:
    for name in NAMES:
        shown = harmless(name)
        assert len(shown) <= 63
        assert set(shown) <= {*"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789<>", *HARMLESS}
    assert harmless("area_2") == "area_2"
    assert harmless("λ*/") == "<U+03BB><U+002A>/"
    assert harmless("a" * 61) == "a" * 60 + "..."
    assert harmless("λ" * 10) == "<U+03BB>" * 7 + "..."
    assert "*" not in HARMLESS
    assert "\\" not in HARMLESS
    assert "?" not in HARMLESS


@pytest.mark.parametrize("name", NAMES[::4], ids=lambda name: ascii(name)[:20])
def test_each_name_alone(name: str) -> None:
    """As a parameter, by keyword where that is possible and in a dict, with its gradient."""
    e, (p,) = scene([name])
    f = teg.compile(e, [p], backend="c")  # type: ignore[list-item]
    assert f(**{name: 0.5}) == f({name: 0.5}) == f(0.5) == 0.25
    assert f.grad({name: np.array([0.5, 0.25])})[name].tolist() == [1.0, 0.5]
    check_comments(f.source)


def test_all_names_at_once() -> None:
    e, parameters = scene(NAMES)
    given = dict(zip(NAMES, np.linspace(0.1, 0.9, len(NAMES)), strict=True))
    c, numpy = (teg.compile(e, parameters, backend=b) for b in ("c", "numpy"))  # type: ignore[arg-type]
    assert c.parameters == tuple(NAMES)
    value, gradient = c.value_and_grad(given)
    wanted, slopes = numpy.value_and_grad(given)
    assert value == pytest.approx(wanted, rel=1e-14)
    assert gradient == pytest.approx(slopes, rel=1e-14)


def test_standalone_files(tmp_path: Path) -> None:
    """The header lists them all in order, and both files compile where comments in comments are errors."""
    e, parameters = scene(NAMES)
    f = teg.compile(e, parameters)  # type: ignore[arg-type]
    texts = standalone_c(f.program(1), "odd", f.output_names(1))
    for suffix, text in zip("ch", texts, strict=True):
        check_comments(text)
        (tmp_path / f"odd.{suffix}").write_text(text, encoding="ascii")
    listed = re.findall(r"^ +p\[(\d+)\]  (.*)$", texts[1], re.MULTILINE)
    assert [int(i) for i, _ in listed] == list(range(len(NAMES)))
    assert [shown.rstrip() for _, shown in listed] == [harmless(name).rstrip() for name in NAMES]
    assert len(re.findall(r"^ +out\[\d+\]", texts[1], re.MULTILINE)) == 1 + len(NAMES)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "odd.h"\nint main(void) { double one = 0.5, found[ODD_OUTPUTS], *out[ODD_OUTPUTS];\n'
        "const double *p[ODD_INPUTS]; long stride[ODD_INPUTS]; for (int i = 0; i < ODD_INPUTS; i++) p[i] = &one, stride[i] = 0;\n"
        "for (int j = 0; j < ODD_OUTPUTS; j++) out[j] = &found[j];\n"
        'const int bad = odd(1, p, stride, NULL, out, NULL, 1); printf("%.17g", found[0]); return bad; }\n'
    )
    _compile(tmp_path, *STRICT, "-Wcomment", "-Wtrigraphs", "main.c", "odd.c", "-o", "main", "-lm")
    printed = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True).stdout
    assert float(printed) == pytest.approx(0.25 * len(NAMES) * (len(NAMES) + 1) / 2, rel=1e-14)


def test_an_array_of_such_a_name() -> None:
    k = teg.index("k*/")
    for name in ("V*/ #error", "int", "λ\n", "a" * 10_000):
        v, i = Array.make((name, 1), ()), IndexArray.make((name + "of", 1), ())
        e = teg.sum(v[i[k]] ** 2, (k, 0, teg.length(i, 0)))
        f = teg.compile(e, [v], backend="c")
        given = {name: np.array([1.0, 2.0, 3.0]), name + "of": np.array([2, 0, 2])}
        assert f(given) == 19.0
        assert f.grad(given)[name].tolist() == [2.0, 0.0, 12.0]
        assert f.source.isascii()
        assert not HOSTILE.search(f.source)


def test_a_file_that_is_named_oddly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "a; rm -rf $HOME.py"
    source.write_text("import teg\ne = teg.param('t') ** 2\n")
    assert main(["compile", str(source), "-o", str(tmp_path / "square.c")]) == 0
    assert main(["compile", str(source), "-o", str(tmp_path / "a; b.c")]) == 2
    assert "a; b" in capsys.readouterr().err
