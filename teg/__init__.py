"""Teg: a compiler for integrals over discontinuous programs, with correct derivatives.

import teg
x, y = teg.vars("x y")
t = teg.param("t")
area = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
f = teg.compile(area, [t])
value, gradient = f.value_and_grad(t=0.5)          # 0.125, {"t": 0.5}
"""

from teg.build import abs_ as abs
from teg.build import (
    acos,
    asin,
    atan,
    atan2,
    bracket,
    cos,
    cosh,
    delta,
    exp,
    floor,
    integral,
    log,
    maximum,
    minimum,
    mod,
    param,
    params,
    sign,
    sin,
    sinh,
    sqrt,
    tan,
    tanh,
    var,
    vars,
    where,
)
from teg.build import tuple_ as tuple
from teg.check import GradientReport, check_gradient
from teg.compile import Evaluator, compile, evaluate
from teg.diagnose import Diagnosis
from teg.dump import dump
from teg.errors import TegError
from teg.explain import Explanation, explain
from teg.expr import Cond, Expr
from teg.latex import latex
from teg.pipeline import diff, eliminate, grad, hessian, jvp
from teg.traverse import size

__version__ = "0.1.0"

__all__ = [
    "Cond", "Diagnosis", "Evaluator", "Explanation", "Expr", "GradientReport", "TegError", "abs", "acos", "asin", "atan", "atan2",
    "bracket", "check_gradient", "compile", "cos", "cosh", "delta", "diff", "dump", "eliminate", "evaluate", "exp", "explain", "floor",
    "grad", "hessian", "integral", "jvp", "latex", "log", "maximum", "minimum", "mod", "param", "params", "sign", "sin", "sinh", "size",
    "sqrt", "tan", "tanh", "tuple", "var", "vars", "where",
]  # fmt: skip
