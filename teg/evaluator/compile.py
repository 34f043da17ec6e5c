"""`teg.compile` and `teg.evaluate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from inspect import signature
from typing import Any

from teg.analysis.isolation import MAX_ROOTS
from teg.analysis.settings import Integration, Rule
from teg.errors import ParameterError
from teg.evaluator.arguments import by_name, refuse_nested
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import (
    DEFAULT_TOLS,
    Backend,
    Discontinuities,
    DType,
    Functions,
    Inaccurate,
    Jumps,
    Machine,
    Options,
    checked_dtype,
    parameters_of,
    rule_for,
)
from teg.ir.creation import is_created
from teg.ir.expr import Operand, Tuple
from teg.ir.operands import as_number
from teg.language.checks import check_program
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.through_sums import Parameter
from teg.pipeline import estimator_for


def compile(
    e: Operand,
    parameters: Sequence[Parameter] | Parameter | None = None,
    *,
    backend: Backend = "numpy",
    tol: float | None = None,
    rule: Rule = "auto",
    order: int | None = None,
    seed: int = 0,
    inaccurate: Inaccurate = "warn",
    dtype: DType = "float64",
    threads: int = 1,
    memory: int = 256 * 2**20,
    discontinuities: Discontinuities = "exact",
    samples: int | None = None,
    sigma: float | None = None,
    estimator: Mapping[str, Any] | None = None,
    max_roots: int = MAX_ROOTS,
    maps: Sequence[Diffeomorphism] = (),
    check_maps: bool = True,
    functions: Functions = "linked",
    intrinsics: bool = True,
) -> Evaluator:
    """Returns the `Evaluator` of a closed expression, of its gradient and of its Hessian.

        f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, a])
        value, gradient = f.value_and_grad(t=0.5, a=2.0)
        gradient["t"]                             # 2.718281828459045

    `parameters` are those to differentiate by, arrays among them, in the order of `f.parameters` (default: all that occur in e; others
    that occur are arguments after them). `backend` is "numpy", "c" or "jax". `threads` are the C backend's (0: one for each processor;
    results are the same for any number), `memory` (bytes) bounds the NumPy backend's temporary arrays. `discontinuities` says what
    becomes of the jumps when the program is differentiated (see below).
    `max_roots` is for how many roots of a condition there is room at first, if no theorem bounds their number. A call that meets more of
    them makes the program again with more room, up to 4096.

    `dtype`, "float64" or "float32", is what values of parameters are rounded to when they come in, and results when they go out. All
    between is computed in float64, by JAX too where x64 is off: where surfaces cross and pieces end takes its digits, and single precision
    would save little of a call's time.

    `tol` (1e-10, for float32 1e-6) is the tolerance, absolute and relative to the integral of |integrand| over a piece. `rule`, and what
    `order` means to it:

        "auto"        exact with the fewest nodes where the integrand is a polynomial between its breaks, else "adaptive"
        "adaptive"    Gauss-Legendre between the breaks, halved until the error estimate is below `tol`; order: nodes of the first look
        "gauss"       exact where "auto" is with no more, else `order` (16) nodes a piece and variable, whatever the error
        "midpoint"    `order` (256) points a variable, breaks ignored: the uniform rule of Teg (2021), for comparison
        "montecarlo"  `order` (2¹⁴) independent samples of a whole nest of integrals, from `seed`
        "qmc"         `order` (2¹⁴) points of 8 scrambled Sobol' sequences

    `discontinuities` names an estimator of derivatives. "exact" (or "sift") integrates along the surfaces and is right to `tol`; the others
    are those of the literature, for comparison (docs/estimators.md): "ignore" (plain automatic differentiation), "differences", "spsa",
    "edge-mc", "warp", "warp-blur" and "smooth". They give first derivatives, in C and NumPy; a choice among data (`teg.nearest`) is for
    "exact", "ignore" and, with `estimator={"gamma": …}`, "smooth". Their integrals, the value's among them, are means over `samples`
    points (2¹⁴) from `seed`, unless `rule` is another one than "auto". `sigma` is the width of "smooth" and "warp-blur"; `estimator` holds
    further options by name, as `{"richardson": True}` or `{"sampling": "importance"}`, which the estimators' classes document. Errors that
    `f.grad_and_error` estimates are standard errors; a bias is not in them.

    `inaccurate` says what happens where the tolerance is not reached, or an integral diverges: "warn" (AccuracyWarning, with the
    estimate), "raise" (AccuracyError) or "ignore".

    `maps` are changes of variables for the surfaces that move (`teg.Diffeomorphism`, `teg.maps`): where the integrals over all old
    variables of a map stand inside each other, the delta of a surface that depends on one new variable only, or has a formula in the new
    variables and none without, is eliminated in these; or in the old ones, in a program that is written in the new ones. The results are
    those of `teg.change_variables` on the integrals of these deltas. Every call verifies the maps for its parameter values (of a batch:
    at most 64 elements), which `check_maps=False` leaves out, and raises DiffeomorphismError.

    `functions` says how those of `teg.function` are compiled: "linked" each by itself, so that a program with other bodies shares what was
    done for the rest; "inlined" as if they were written out by hand: faster code, and programs with other bodies share nothing.

    `intrinsics=False` turns off the fast paths of single shapes of programs (`teg.passes.intrinsics`): clipped polygons and polyhedra,
    moments of hyperbolas, weights for poles. The results are the same to the tolerance, by slower and more general means. A `rule` or an
    `order` turns them off too.

    Raises ScopeError for a free variable, NameClashError for one name given to two things, OptionError for an option that is unknown.
    The gradient is derived when it is first asked for; a surface that no family can reduce raises NoReparameterisationError then.
    """
    program = e if isinstance(e, Tuple) else as_number(e)
    check_program(program)
    precision = checked_dtype(dtype)
    chosen = estimator_for(discontinuities, {**(estimator or {}), **({} if sigma is None else {"sigma": sigma})})
    how = rule_for(chosen, backend, rule, order, samples)
    integration = Integration(DEFAULT_TOLS[precision] if tol is None else tol, *how, seed, max_roots, intrinsics)
    fitted = chosen.fitted(integration)
    machine, jumps = Machine(backend, threads, memory), Jumps(fitted, maps, check_maps)
    options = Options(machine, integration, inaccurate, precision, jumps, functions)
    if parameters is None:
        return Evaluator(program, None, options)
    return Evaluator(program, parameters_of(program, parameters), options)


def evaluate(e: Operand, values: Mapping[Any, Any] | None = None, *, backend: Backend = "numpy", **values_and_options: Any) -> Any:
    """Returns the value of an expression at parameter values; e may hold deltas and derivatives.

        teg.evaluate(teg.integral(x * t, (x, 0, 1)), {t: 3.0})  # 1.5
        teg.evaluate(t**2, t=0.5)                        # 0.25

    Values are given in a dict (keys are parameters or their names), by name, or both. The other keywords are those of `teg.compile`; the
    value of a parameter with the name of an option stands in the dict. Values of parameters that e does not have are ignored, because a
    derivative may have lost some.

    The result is a Python float, an array of the batch's shape, or a tuple of these. Raises ParameterError for a value that is missing or
    given twice, or a keyword that is neither an option nor a parameter, and the errors of `teg.compile`.
    """
    options = {k: v for k, v in values_and_options.items() if k in OPTIONS}
    named = {k: v for k, v in values_and_options.items() if k not in OPTIONS}
    if values is not None and not isinstance(values, Mapping):
        hint = "teg.evaluate(e, {t: 0.5}), or by name: teg.evaluate(e, t=0.5)"
        raise ParameterError(f"values are given in a dict, not in {type(values).__name__} {values!r:.80}", None, hint)
    f = compile(e, backend=backend, **options)
    given = by_name(values or {})
    refuse_nested(given, f.parameters)
    for k, v in named.items():
        if k in given:
            raise ParameterError(f"the parameter {k!r} is given twice", None, "by name, or in the dict")
        if k not in f.parameters and not is_created(k):
            close = get_close_matches(k, [*f.parameters, *OPTIONS], 1)
            raise ParameterError(f"{k!r} is neither a parameter nor an option", None, f"is it {close[0]!r}?" if close else "")
        given[k] = v
    if clash := [k for k in f.parameters if k in OPTIONS and k in options and k not in given]:
        raise ParameterError(f"{clash[0]!r} is an option and a parameter", None, f"the parameter's value in the dict: {{{clash[0]!r}: …}}")
    return f({k: v for k, v in given.items() if k in f.parameters})


OPTIONS = frozenset(signature(compile).parameters) - {"e", "parameters"}
"""The names of the options of a compilation."""
