"""`teg.explain`: the report on an expression, as it would be compiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from teg.analysis.bodies import write_all_out
from teg.analysis.isolation import MAX_ROOTS
from teg.analysis.settings import Integration, Rule
from teg.errors import OptionError
from teg.evaluator.derivation import Derivation, Task, followed
from teg.evaluator.options import Discontinuities, parameters_of
from teg.evaluator.wanted import ORDERS
from teg.ir.arrays import Array, arrays_of, has_arrays, integer_parameters, integers_of
from teg.ir.cells import check_indices, replace_integers
from teg.ir.expr import Expr, Operand, Param, Tuple
from teg.ir.index import Index, Length, index_const, index_leaves
from teg.ir.node import postorder
from teg.ir.operands import as_number
from teg.ir.traverse import parameters
from teg.language.checks import check_program
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.through_sums import Parameter, outlined
from teg.passes.normalise.padded import ranges_of_data, with_most
from teg.passes.normalise.sums import NeedsLengths
from teg.pipeline import estimator_for
from teg.program.arrays import ArrayProgram
from teg.report.explain import Asked, explain_cell, explain_loops
from teg.report.explanation import Explanation

ASSUMED = 2
"""The assumed length of every array, if the program must be known for lengths and none are given."""


def explain(
    expression: Operand,
    wrt: Sequence[Parameter] | Parameter | None = None,
    tol: float = 1e-10,
    *,
    rule: Rule = "auto",
    order: int | None = None,
    seed: int = 0,
    discontinuities: Discontinuities = "exact",
    derivatives: int = 0,
    maps: Sequence[Diffeomorphism] = (),
    max_roots: int = MAX_ROOTS,
    intrinsics: bool = True,
) -> Explanation:
    """Returns a report on an expression: the owner of each surface and the elimination of its δ; breaks, rule and nodes of each integral;
    the cost.

        print(teg.explain(e, [t]))
        teg.explain(e, [t]).data["surfaces"][0]["surface"]  # 't - (x + a·y) = 0'

    Derivatives are taken by the parameters `wrt` (default: all). `tol`, `rule`, `order`, `seed`, `discontinuities`, `maps`, `max_roots`
    and `intrinsics` are those of `compile`, and `f.explain()` fills them in. The integrals are those of the value and, of the gradient,
    those over surfaces (`derivatives=0`) or all (`derivatives=1`). The evaluations of the integrand are an estimate: every break inside
    the bounds, adaptive integrals as smooth as they can be (`f.evaluations(…)` counts those of a call).

    A program with arrays is explained cell by cell (`explanation.ArrayExplanation`): the parts between its sums are scalar programs of
    the entries they read, and of the sums inside; and its loops are listed.

    Raises OptionError for a `derivatives` other than 0 or 1, and the errors of `compile` for an expression that is not closed.
    """
    e = expression if isinstance(expression, Tuple) else as_number(expression)
    check_program(e)
    how = Integration(tol, rule, order, seed, max_roots, intrinsics)
    asked = Asked(how, estimator_for(discontinuities, how=how), maps, checked_derivatives(derivatives))
    if wrt is None:
        return explained(e, None, asked)
    return explained(e, parameters_of(e, wrt), asked)


def checked_derivatives(derivatives: int) -> int:
    """Returns the option `derivatives`. Raises OptionError if it is not 0 or 1."""
    if derivatives not in (0, 1):
        raise OptionError(f"derivatives={derivatives!r} is not known", None, "0: value and boundary integrals; 1: all of the gradient")
    return derivatives


def explained(e: Expr, wrt: Sequence[Parameter] | None, asked: Asked) -> Explanation:
    """Returns the explanation of a program that is differentiated by some parameters (default: all)."""
    if not (has_arrays(e) or any(isinstance(p, Array) for p in wrt or ())):
        return explain_cell(e, cast("Sequence[Param]", parameters(e) if wrt is None else wrt), asked)
    e = write_all_out(e)
    check_indices(e)
    counted, arrays = integer_parameters(e), [a for a in arrays_of(e) if isinstance(a, Array)]
    chosen: list[Parameter] = [*(p for p in parameters(e) if p not in set(counted)), *arrays] if wrt is None else list(wrt)
    try:
        plain, edges, slopes = followed(outlined(e, asked.estimator.name == "exact"), chosen)
    except NeedsLengths:
        lengths = [n for node in postorder([e]) for n in index_leaves(integers_of(node)) if isinstance(n, Length)]
        assumed: dict[Index, Index] = {n: index_const(ASSUMED) for n in lengths}
        bounded = with_most(e, dict.fromkeys(ranges_of_data(e), ASSUMED))
        plain, asked = outlined(replace_integers(bounded, assumed)), replace(asked, assumed_length=ASSUMED)
        edges, slopes = {}, {}
    leaves = tuple(dict.fromkeys([*chosen, *parameters(e), *counted, *arrays_of(e)]))
    how = asked.integration, asked.estimator, tuple(asked.maps)
    task = Task(plain, tuple(chosen), leaves, (), *how, edges=tuple(edges.items()))
    derivation = Derivation(task, slopes)

    def program_of(orders: int) -> ArrayProgram:
        return cast(ArrayProgram, derivation.program(ORDERS[orders]))

    return explain_loops(e, task.computed(plain), chosen, asked, program_of)
