"""The list of passes: the one screen to read first.

    value        to_atoms → eliminations, if it has δ                                               `normal_form`
    derivative   a normal form that keeps moving δ → tangent or adjoint                             `diff`, `jvp`, `grad`, `hessian`
    compiled     value, and adjoints without δ → centre → canonicalise, all outputs together        `compiled_outputs`
                 lower → to_finished: one flat program, which a backend prints                      `program_for`

A pass is `Expr -> Expr`, once lowered `Program -> Program`; `lower` is `Expr -> Program`. TEG_DUMP=all, or a pass's name, prints the
program after passes; TEG_VERIFY=1 checks it between them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import cast

from teg.analysis.remarks import Remarks
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
from teg.passes.intrinsics import boundary_terms, intrinsics_for
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
from teg.passes.program.link import with_bodies
from teg.passes.program.sink import sink
from teg.program import Program
from teg.program.show import listing
from teg.program.verify import verified

Pass = Callable[[Expr], Expr]
ProgramPass = Callable[[Program], Program]
Maps = Sequence[Diffeomorphism]

ESTIMATORS: dict[str, Pass] = {
    "sift": eliminate_deltas,  # ours: the boundary integrals
    "ignore": ignore_discontinuities,  # what plain automatic differentiation computes
}
"""What becomes of the deltas of a derivative, by the name that `compile(discontinuities=…)` takes."""


def to_atoms(keep_moving: bool, maps: Maps, canonical: Canonical) -> list[tuple[str, Pass]]:
    """Canonical atoms, split integrals; with `keep_moving` surfaces that are carried along have a δ."""
    return [
        ("inline", write_out),  # what jumps inside of a function has to be seen
        ("differences", with_differences),  # before products of far coordinates are differentiated
        *([] if maps else [("corners", with_local_boxes)]),  # maps are between coordinates as users write them
        *([("carried", with_deltas)] if keep_moving else []),
        ("steps", enumerate_steps),  # the steps of floor are brackets, hence atoms
        ("canonicalise", canonical),  # a surface must be one expression before its jump can be taken
    ]


def eliminations(keep_moving: bool, maps: Maps, canonical: Canonical, remarks: Remarks | None = None) -> list[tuple[str, Pass]]:
    """No δ; but for those that are carried along, if the program is to be differentiated again (`keep_moving`)."""
    return [
        ("finite bounds", with_finite_bounds),
        ("eliminate", partial(eliminate_deltas, keep_moving=keep_moving, families=families_with(maps), remarks=remarks)),
        ("canonicalise", canonical),  # sifting makes new atoms
    ]


def to_finished(errors: bool) -> list[tuple[str, ProgramPass]]:
    """A flat program that a backend prints; with `errors`, an estimate of the error of each output behind them."""
    return [
        *([("errors", with_error_estimates)] if errors else []),
        ("sink", sink),  # behind estimates: what one polygon uses is computed in it
        ("link", with_bodies),
    ]


def run_pass(name: str, step: Pass, e: Expr) -> Expr:
    """One pass over an expression, with the checks and prints the environment asks for."""
    result = step(e)
    if is_dumped(name):
        sys.stderr.write(f"-- after {name} --\n{dump(result)}\n")
    if os.environ.get("TEG_VERIFY"):
        verify(result, f"after {name}")
    return result


def run_passes(passes: Sequence[tuple[str, Pass]], e: Expr) -> Expr:
    """Passes over an expression, in their order."""
    for name, step in passes:
        e = run_pass(name, step, e)
    return e


def checked(name: str, program: Program) -> Program:
    """The program that a pass made, with the checks and prints the environment asks for."""
    if is_dumped(name):
        sys.stderr.write(f"-- after {name} --\n{listing(program)}\n")
    return verified(program, f"after {name}")


def is_dumped(name: str) -> bool:
    """Whether the environment asks for the program after a pass."""
    return os.environ.get("TEG_DUMP", "") in ("all", name)


def normal_form(
    e: Expr, keep_moving: bool = False, maps: Maps = (), canonical: Canonical | None = None, remarks: Remarks | None = None
) -> Expr:
    """Canonical atoms, split integrals, no δ; but for those that are carried along, if e is to be differentiated again (`keep_moving`).
    `remarks` are told what passes decide."""
    canonical = canonical or Canonical()
    e = run_passes(to_atoms(keep_moving, maps, canonical), e)
    return run_passes(eliminations(keep_moving, maps, canonical, remarks), e) if e.has_delta else e


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
    e: Expr,
    wrt: Sequence[Param],
    orders: int,
    discontinuities: str,
    maps: Maps = (),
    closed_forms: bool = True,
    remarks: Remarks | None = None,
) -> list[Expr]:
    """[value], [value, gradient], or [value, gradient, Hessian] as δ-free expressions in canonical form, ready to be lowered together.

    Boundary terms without a rule of integration are among them only with `closed_forms`. `remarks` are told what passes decide.
    """
    e, families, sifted = write_out(e), families_with(maps), discontinuities == "sift"
    last_families = closing(families, boundary_terms(remarks)) if closed_forms else families
    estimate = partial(eliminate_deltas, families=last_families, remarks=remarks) if sifted else ESTIMATORS[discontinuities]
    canonical = Canonical()  # what is canonical already is met again at the end
    outputs = [normal_form(e, maps=maps, canonical=canonical, remarks=remarks)]
    source = normal_form(e, True, maps, canonical, remarks) if e.has_delta else outputs[0]
    for order in range(orders):
        source = _with_moving_steps(source, wrt) if sifted else without_uncounted(source, wrt)
        raw: Expr = run_pass("adjoint", partial(gradient_of, wrt=wrt), source)
        last = order + 1 == orders
        if sifted:
            raw = run_pass("finite bounds", with_finite_bounds, raw)
        if not last and sifted:  # what is carried along is eliminated beside, not before, the next derivative
            raw = run_pass("eliminate", partial(eliminate_deltas, keep_moving=True, families=families, remarks=remarks), raw)
        outputs.append(run_pass(discontinuities, estimate, raw))
        if not last:
            source = run_pass("canonicalise", canonical, raw if sifted else outputs[-1])
    outputs = [run_pass("centre", centred, output) for output in outputs]
    together = run_pass("canonicalise", canonical, ex.tuple_of(*outputs))  # one surface is one expression, so that outputs share loops
    return list(cast(Tuple, together).children)


def flat_program(outputs: Sequence[Expr], names: Sequence[str], how: Integration, remarks: Remarks | None = None) -> Program:
    """The flat program of outputs without δ, before the passes over flat programs; `remarks` are told how integrals are computed."""
    return checked("lower", schedule(outputs, names, how, intrinsics_for(how), remarks))


def finished(program: Program, errors: bool = False) -> Program:
    """The program after the passes over flat programs."""
    for name, step in to_finished(errors):
        program = checked(name, step(program))
    return program


def program_for(
    outputs: Sequence[Expr], names: Sequence[str], how: Integration, errors: bool = False, remarks: Remarks | None = None
) -> Program:
    """The finished program of outputs without δ; with `errors`, an estimate of the error of each behind them."""
    return finished(flat_program(outputs, names, how, remarks), errors)


def cell_program(outputs: Sequence[Expr], names: Sequence[str], how: Integration) -> Program:
    """The same for a part of a program with arrays, without estimates: these follow the loops."""
    return program_for(outputs, names, how)


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
