"""Teg: a compiler for integrals over discontinuous programs, with correct derivatives.

import teg
x, y = teg.vars("x y")
t = teg.param("t")
area = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
f = teg.compile(area, [t])
value, gradient = f.value_and_grad(t=0.5)          # 0.125, {"t": 0.5}
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

from teg import errors
from teg.errors import AccuracyError, ArrayIndexError, DiffeomorphismError, TegError
from teg.ir.arrays import Array, array, index, indices, length
from teg.ir.arrays import sum_ as sum
from teg.ir.choices import all_ as all
from teg.ir.choices import any_ as any
from teg.ir.choices import maximum_of, minimum_of, nearest, prod
from teg.ir.expr import Cond, Expr, Param, Tuple, Var
from teg.ir.foreign_names import OTHER_NAMES, WRITTEN
from teg.ir.function import Function, function
from teg.ir.index import Index
from teg.ir.latex import latex
from teg.ir.show import dump
from teg.ir.substitution import let, substitute
from teg.ir.traverse import size
from teg.language.functions import abs_ as abs
from teg.language.functions import (
    acos,
    asin,
    atan,
    atan2,
    ceil,
    cos,
    cosh,
    erf,
    erfc,
    exp,
    expm1,
    floor,
    log,
    log1p,
    maximum,
    minimum,
    mod,
    sign,
    sin,
    sinh,
    sqrt,
    tan,
    tanh,
)
from teg.language.functions import round_ as round
from teg.language.programs import bracket, delta, integral, param, params, var, vars, where
from teg.language.programs import tuple_ as tuple

if TYPE_CHECKING:
    from teg import maps
    from teg.derivatives import diff, eliminate, grad, hessian, jvp, stop_delta
    from teg.evaluator.accuracy import AccuracyWarning
    from teg.evaluator.check import GradientReport, check_gradient
    from teg.evaluator.compile import compile, evaluate
    from teg.evaluator.evaluator import ArrayEvaluator, Evaluator
    from teg.evaluator.explain import explain
    from teg.interop.jax import jax_function
    from teg.interop.jax_cache import jax_cache
    from teg.interop.scipy import scipy_function
    from teg.interop.torch import torch_function
    from teg.maps import polar
    from teg.maps.diffeomorphism import Diffeomorphism
    from teg.passes.eliminate.mapped import change_variables
    from teg.report.diagnose import Diagnosis
    from teg.report.explanation import Explanation
    from teg.symbolic import from_sympy, to_sympy

_LOADED_ON_FIRST_USE = {
    "teg.derivatives": ("diff", "eliminate", "grad", "hessian", "jvp", "stop_delta"),
    "teg.evaluator.accuracy": ("AccuracyWarning",),
    "teg.evaluator.check": ("GradientReport", "check_gradient"),
    "teg.evaluator.compile": ("compile", "evaluate"),
    "teg.evaluator.evaluator": ("ArrayEvaluator", "Evaluator"),
    "teg.evaluator.explain": ("explain",),
    "teg.interop.jax": ("jax_function",),
    "teg.interop.jax_cache": ("jax_cache",),
    "teg.interop.scipy": ("scipy_function",),
    "teg.interop.torch": ("torch_function",),
    "teg.maps": ("polar",),
    "teg.maps.diffeomorphism": ("Diffeomorphism",),
    "teg.passes.eliminate.mapped": ("change_variables",),
    "teg.report.diagnose": ("Diagnosis",),
    "teg.report.explanation": ("Explanation",),
    "teg.symbolic": ("from_sympy", "to_sympy"),
}
"""Public names by module. Each module is imported when one of its names is first used, because importing the whole
compiler takes 0.2 s."""

__version__ = "0.1.0"

__all__ = [
    "AccuracyError", "AccuracyWarning", "Array", "ArrayEvaluator", "ArrayIndexError", "Cond", "Diagnosis", "Diffeomorphism",
    "DiffeomorphismError", "Evaluator", "Explanation", "Expr", "Function", "GradientReport", "Index", "Param", "TegError", "Tuple",
    "Var", "abs", "acos", "all", "any", "array", "asin", "atan", "atan2", "bracket", "ceil", "change_variables", "check_gradient",
    "compile", "cos", "cosh", "delta", "diff", "dump", "eliminate", "erf", "erfc", "errors", "evaluate", "exp", "explain", "expm1",
    "floor", "from_sympy", "function", "grad", "hessian", "index", "indices", "integral", "jax_cache", "jax_function", "jvp", "latex",
    "length", "let", "log", "log1p", "maps", "maximum", "maximum_of", "minimum", "minimum_of", "mod", "nearest", "param", "params", "polar",
    "prod", "round", "scipy_function", "sign", "sin", "sinh", "size", "sqrt", "stop_delta", "substitute", "sum", "tan", "tanh",
    "to_sympy", "torch_function", "tuple", "var", "vars", "where",
]  # fmt: skip

_MODULE_OF = {name: module for module, names in _LOADED_ON_FIRST_USE.items() for name in names}


def __getattr__(name: str) -> object:
    """Returns the public object `name`, imported now."""
    if name == "maps":
        return import_module("teg.maps")
    if name not in _MODULE_OF:
        hint = f"; there is teg.{OTHER_NAMES[name]}" if name in OTHER_NAMES else f"; write {WRITTEN[name]}" if name in WRITTEN else ""
        raise AttributeError(f"module 'teg' has no attribute {name!r}{hint}", name=name, obj=sys.modules[__name__])
    value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    """Returns the public names: those of `__all__`, the module `errors` and the version."""
    return sorted([*__all__, "__version__"])
