"""Teg: a compiler for integrals over discontinuous programs, with correct derivatives.

import teg
x, y = teg.vars("x y")
t = teg.param("t")
area = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
f = teg.compile(area, [t])
value, gradient = f.value_and_grad(t=0.5)          # 0.125, {"t": 0.5}
"""

from teg import maps
from teg.derivatives import diff, eliminate, grad, hessian, jvp
from teg.errors import AccuracyError, ArrayIndexError, DiffeomorphismError, TegError
from teg.evaluator.accuracy import AccuracyWarning
from teg.evaluator.check import GradientReport, check_gradient
from teg.evaluator.compile import compile, evaluate
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.evaluator import Evaluator as ArrayEvaluator
from teg.evaluator.explain import explain
from teg.interop.jax import jax_function
from teg.interop.scipy import scipy_function
from teg.interop.torch import torch_function
from teg.ir.arrays import array, index, indices, length
from teg.ir.arrays import sum_ as sum
from teg.ir.expr import Cond, Expr
from teg.ir.function import Function, function
from teg.ir.latex import latex
from teg.ir.show import dump
from teg.ir.traverse import size
from teg.language import abs_ as abs
from teg.language import (
    acos,
    asin,
    atan,
    atan2,
    bracket,
    ceil,
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
from teg.language import round_ as round
from teg.language import tuple_ as tuple
from teg.maps import polar
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.eliminate.mapped import change_variables
from teg.report.diagnose import Diagnosis
from teg.report.explanation import Explanation
from teg.symbolic import from_sympy, to_sympy

__version__ = "0.1.0"

__all__ = [
    "AccuracyError", "AccuracyWarning", "ArrayEvaluator", "ArrayIndexError", "Cond", "Diagnosis", "Diffeomorphism", "DiffeomorphismError",
    "Evaluator", "Explanation", "Expr", "Function", "GradientReport", "TegError", "abs", "acos", "array", "asin", "atan", "atan2",
    "bracket", "ceil", "change_variables", "check_gradient", "compile", "cos", "cosh", "delta", "diff", "dump", "eliminate", "evaluate",
    "exp", "explain", "floor", "from_sympy", "function", "grad", "hessian", "index", "indices", "integral", "jax_function", "jvp", "latex",
    "length", "log", "maps", "maximum", "minimum", "mod", "param", "params", "polar", "round", "scipy_function", "sign", "sin", "sinh",
    "size", "sqrt", "sum", "tan", "tanh", "to_sympy", "torch_function", "tuple", "var", "vars", "where",
]  # fmt: skip
