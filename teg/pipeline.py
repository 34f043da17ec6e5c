"""The list of passes: the one screen to read first.

    value        functions → differences → steps of floor → canonicalise → eliminate δ → canonicalise → schedule
    derivative   functions → differences → steps of floor → canonicalise → (eliminate δ) → tangent or adjoint    `diff`, `grad`
    compiled     … → eliminate δ → canonicalise → schedule → a backend prints it

A pass is `Expr -> Expr` (the last one `Expr -> Program`). TEG_DUMP=all, or a pass's name, prints the program after passes;
TEG_VERIFY=1 checks it between them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import cast

from teg.analysis.settings import Integration
from teg.errors import ParameterError
from teg.ir import expr as ex
from teg.ir.expr import ONE, Expr, Param, Tuple, as_number
from teg.ir.show import dump
from teg.ir.traverse import parameters
from teg.ir.verify import verify
from teg.language import check_parameters
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.forward import tangent_of
from teg.passes.differentiate.ignore import ignore_discontinuities
from teg.passes.differentiate.reverse import gradient_of
from teg.passes.eliminate.families import closing, eliminate_deltas, families_with
from teg.passes.eliminate.implicit import with_deltas
from teg.passes.lower.integrals import schedule
from teg.passes.normalise.canonicalise import Canonical
from teg.passes.normalise.centre import centred
from teg.passes.normalise.corners import with_local_boxes
from teg.passes.normalise.finite_bounds import with_finite_bounds
from teg.passes.normalise.inline import write_out
from teg.passes.normalise.origins import with_differences
from teg.passes.normalise.steps import enumerate_steps
from teg.passes.normalise.too_many_steps import check_steps, without_uncounted
from teg.passes.program.errors import with_error_estimates
from teg.passes.program.group import group
from teg.passes.program.link import with_bodies
from teg.passes.program.sink import sink
from teg.program import Program
from teg.program.verify import verified

Pass = Callable[[Expr], Expr]
Maps = Sequence[Diffeomorphism]

ESTIMATORS: dict[str, Pass] = {
    "sift": eliminate_deltas,  # ours: the boundary integrals
    "ignore": ignore_discontinuities,  # what plain automatic differentiation computes
}
"""What becomes of the deltas of a derivative, by the name that `compile(discontinuities=…)` takes."""


def run_pass(name: str, step: Pass, e: Expr) -> Expr:
    """One pass, with the checks and prints the environment asks for."""
    result = step(e)
    wanted = os.environ.get("TEG_DUMP", "")
    if wanted in ("all", name):
        sys.stderr.write(f"-- after {name} --\n{dump(result)}\n")
    if os.environ.get("TEG_VERIFY"):
        verify(result, f"after {name}")
    return result


def normal_form(e: Expr, keep_moving: bool = False, maps: Maps = (), canonical: Canonical | None = None) -> Expr:
    """Canonical atoms, split integrals, no δ; but for those that are carried along, if e is to be differentiated again (`keep_moving`)."""
    canonical = canonical or Canonical()
    e = run_pass("inline", write_out, e)  # first: what jumps inside of a function has to be seen
    e = run_pass("differences", with_differences, e)  # before products of far coordinates are differentiated
    e = e if maps else run_pass("corners", with_local_boxes, e)  # maps are between coordinates as users write them
    e = run_pass("steps", enumerate_steps, with_deltas(e) if keep_moving else e)  # first: the steps of floor are brackets, hence atoms
    e = run_pass("canonicalise", canonical, e)  # a surface must be one expression before its jump can be taken
    if e.has_delta:
        e = run_pass("finite bounds", with_finite_bounds, e)
        e = run_pass("eliminate", partial(eliminate_deltas, keep_moving=keep_moving, families=families_with(maps)), e)
        e = run_pass("canonicalise", canonical, e)  # sifting makes new atoms
    return e


def diff(e: object, by: Param, maps: Maps = ()) -> Expr:
    """The derivative of e by a parameter, deltas visible. A δ in e is eliminated first. A tuple is differentiated entry by entry."""
    (p,) = check_parameters(by)
    return jvp(e, {p: ONE}, maps)


def jvp(e: object, direction: Mapping[Param, object], maps: Maps = ()) -> Expr:
    """The directional derivative Σ ∂e/∂p · direction[p] (forward mode), deltas visible."""
    if not isinstance(direction, Mapping):
        raise ParameterError("a direction is a dict parameter -> change", None, "write teg.jvp(e, {t: 1})")
    check_parameters(list(direction))
    changes = {p: as_number(v) for p, v in direction.items()}
    normal = _with_moving_steps(normal_form(_expression(e), keep_moving=True, maps=maps), list(changes))
    return run_pass("differentiate", lambda u: tangent_of(u, changes), normal)


def grad(e: object, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """The derivatives of e by each parameter (reverse mode; default: all), a tuple, deltas visible. For a tuple e: a tuple of these."""
    wrt = _chosen(e, by)
    normal = _with_moving_steps(normal_form(_expression(e), keep_moving=True, maps=maps), wrt)
    return cast(Tuple, run_pass("adjoint", lambda u: gradient_of(u, wrt), normal))


def hessian(e: object, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """The matrix of second derivatives of e, a tuple of tuples, deltas of the second differentiation visible."""
    wrt = _chosen(e, by)
    return grad(grad(e, wrt, maps), wrt, maps)


def eliminate(e: object, maps: Maps = ()) -> Expr:
    """e without δ: each brought to one variable and sifted, by the user's maps where they help."""
    return normal_form(_expression(e), maps=maps)


def compiled_outputs(
    e: Expr, wrt: Sequence[Param], orders: int, discontinuities: str, maps: Maps = (), closed_forms: bool = True
) -> list[Expr]:
    """[value], [value, gradient], or [value, gradient, Hessian] as δ-free expressions in canonical form, ready to be scheduled together.

    Boundary terms without a rule of integration are among them only with `closed_forms`.
    """
    e, families = write_out(e), families_with(maps)
    estimate = (
        partial(eliminate_deltas, families=closing(families) if closed_forms else families)
        if discontinuities == "sift"
        else ESTIMATORS[discontinuities]
    )
    canonical = Canonical()  # what is canonical already is met again at the end
    outputs = [normal_form(e, maps=maps, canonical=canonical)]
    source = normal_form(e, keep_moving=True, maps=maps, canonical=canonical) if e.has_delta else outputs[0]
    for order in range(orders):
        raw: Expr = gradient_of(_with_moving_steps(source, wrt) if discontinuities == "sift" else without_uncounted(source, wrt), wrt)
        last = order + 1 == orders
        if discontinuities == "sift":
            raw = run_pass("finite bounds", with_finite_bounds, raw)
        if not last and discontinuities == "sift":  # what is carried along is eliminated beside, not before, the next derivative
            raw = run_pass("eliminate", partial(eliminate_deltas, keep_moving=True, families=families), raw)
        outputs.append(run_pass(discontinuities, estimate, raw))
        if not last:
            source = run_pass("canonicalise", canonical, raw if discontinuities == "sift" else outputs[-1])
    outputs = [run_pass("centre", centred, output) for output in outputs]
    together = canonical(ex.tuple_of(*outputs))  # one surface is one expression across the outputs, so that they share loops
    return list(cast(Tuple, together).children)


def program_for(outputs: Sequence[Expr], names: Sequence[str], how: Integration, errors: bool = False) -> Program:
    """The scheduled program of flat outputs; with `errors`, an estimate of the error of each behind them."""
    program = verified(schedule(outputs, names, how), "after schedule")
    if errors:
        program = verified(with_error_estimates(program), "after error estimates")
    program = verified(sink(program), "after sink")
    return verified(with_bodies(verified(group(program), "after group")), "after link")


def cell_program(outputs: Sequence[Expr], names: Sequence[str], how: Integration) -> Program:
    """The same for a part of a program with arrays: branches are made when it has been cut into what each loop computes."""
    program = verified(schedule(outputs, names, how), "after schedule")
    return verified(with_bodies(verified(sink(program), "after sink")), "after link")


def _expression(e: object) -> Expr:
    return e if isinstance(e, Tuple) else as_number(e)


def _with_moving_steps(e: Expr, wrt: Sequence[Param]) -> Expr:
    """A normal form that is to be differentiated: NaN where steps were too many to be written out, an error where they cannot be."""
    e = without_uncounted(e, wrt)
    check_steps(e, wrt)
    return e


def _chosen(e: object, by: Sequence[Param] | Param | None) -> list[Param]:
    return parameters(_expression(e)) if by is None else check_parameters(by)


def flatten(e: Expr) -> list[Expr]:
    """The entries of nested tuples, in order."""
    flat: list[Expr] = []
    stack = [e]
    while stack:
        node = stack.pop()
        if isinstance(node, Tuple):
            stack.extend(reversed(node.children))
        else:
            flat.append(node)
    return flat
