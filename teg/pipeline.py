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
from dataclasses import replace
from functools import partial
from typing import NamedTuple, cast

from teg.analysis.remarks import Remarks
from teg.analysis.settings import Integration
from teg.analysis.sift import deltas_of
from teg.errors import EstimatorError, OptionError, ParameterError, ScopeError
from teg.ir import simplify
from teg.ir.expr import ONE, ZERO, Expr, Param, Tuple, Var
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.ir.operands import as_number
from teg.ir.show import dump
from teg.ir.still import released
from teg.ir.traverse import parameters, rename_apart
from teg.ir.verify import verify
from teg.language.checks import check_parameters
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.estimators.differences import Differences
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.estimators.ignore import Ignore, ignore_discontinuities
from teg.passes.differentiate.estimators.smooth import Smooth
from teg.passes.differentiate.estimators.spsa import Spsa
from teg.passes.differentiate.estimators.warp import Warp
from teg.passes.differentiate.estimators.warp_blur import WarpBlur
from teg.passes.differentiate.forward import tangent_of
from teg.passes.differentiate.missed_cuts import MissedCuts
from teg.passes.differentiate.moving_poles import around_poles
from teg.passes.differentiate.reverse import gradient_of
from teg.passes.eliminate.edge_mc import EdgeMc
from teg.passes.eliminate.families import closing, eliminate_deltas, families_with, is_endless
from teg.passes.eliminate.implicit import with_deltas
from teg.passes.intrinsics import boundary_terms, intrinsics_for
from teg.passes.lower.integrals import ABOUT_NOTHING, About, schedule
from teg.passes.normalise.angles import with_lines_of_angles
from teg.passes.normalise.canonicalise import Canonical
from teg.passes.normalise.centre import centred
from teg.passes.normalise.corners import with_local_boxes
from teg.passes.normalise.cuts import with_cuts
from teg.passes.normalise.exponents import with_common_exponents
from teg.passes.normalise.finite_bounds import with_finite_bounds
from teg.passes.normalise.inline import write_out
from teg.passes.normalise.order import with_few_roots
from teg.passes.normalise.origins import with_differences
from teg.passes.normalise.piecewise import with_smooth_atoms
from teg.passes.normalise.regions import with_regions
from teg.passes.normalise.squares import with_sizes_in_conditions, with_squares_apart
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

ESTIMATORS: dict[str, Estimator] = {e.name: e for e in (Exact(), Ignore(), Differences(), Spsa(), EdgeMc(), Warp(), WarpBlur(), Smooth())}
"""The treatments of the jumps of a derivative, by the names that `compile(discontinuities=…)` takes."""
ALIASES = {"sift": "exact"}
"""Other names of estimators."""


def to_atoms(keep_moving: bool, maps: Maps, canonical: Canonical, whole: bool = False) -> list[tuple[str, Pass]]:
    """Returns the passes to canonical atoms and split integrals. With `keep_moving`, surfaces that are carried along get a δ; with `whole`,
    integrals are not divided where nothing jumps."""
    return [
        ("inline", write_out),  # passes must see the jumps inside of functions
        ("angles", with_lines_of_angles),  # before an angle is cut
        ("cuts", with_cuts),  # the jumps of functions, too
        ("differences", with_differences),  # before products of far coordinates are differentiated
        *([] if maps else [("corners", with_local_boxes)]),  # maps are between the user's coordinates
        *([("carried", with_deltas)] if keep_moving else []),
        ("steps", enumerate_steps),  # the steps of floor are brackets, hence atoms
        ("cuts of steps", with_cuts),  # steps of angles are conditions now
        ("sizes", with_sizes_in_conditions),  # before what has kinks is looked for
        *([] if maps or whole else [("regions", with_regions)]),  # while a kink is one condition
        ("extremes", with_smooth_atoms),  # while what decides an extreme is one condition
        ("squares", with_squares_apart),  # once functions that jump are written out
        ("canonicalise", canonical),  # a surface must be one expression before its jump can be taken
        *([] if maps else [("order", with_few_roots)]),  # of atoms
    ]


def eliminations(keep_moving: bool, maps: Maps, canonical: Canonical, remarks: Remarks | None = None) -> list[tuple[str, Pass]]:
    """Returns the passes that remove δ; with `keep_moving`, those deltas stay that are carried along when the program is differentiated
    again."""
    return [
        ("finite bounds", partial(with_finite_bounds, endless=is_endless)),
        ("eliminate", partial(eliminate_deltas, keep_moving=keep_moving, families=families_with(maps), remarks=remarks)),
        ("canonicalise", canonical),  # sifting makes new atoms
    ]


def to_finished(errors: bool) -> list[tuple[str, ProgramPass]]:
    """Returns the passes to a flat program that a backend prints; with `errors`, error estimates follow the outputs."""
    return [
        *([("errors", with_error_estimates)] if errors else []),
        ("sink", sink),  # after estimates: values that one polygon uses are computed in it
        ("link", with_bodies),
    ]


def run_pass(name: str, step: Pass, e: Expr) -> Expr:
    """Returns the result of one pass over an expression. The environment may ask for it to be printed and verified."""
    result = step(e)
    if is_dumped(name):
        sys.stderr.write(f"-- after {name} --\n{dump(result)}\n")
    if result is not e and os.environ.get("TEG_VERIFY"):
        verify(result, f"after {name}")
    return result


def run_passes(passes: Sequence[tuple[str, Pass]], e: Expr) -> Expr:
    """Returns the result of passes over an expression, in their order."""
    for name, step in passes:
        e = run_pass(name, step, e)
    return e


def checked(name: str, program: Program) -> Program:
    """Returns the program that a pass made. The environment may ask for it to be printed and verified."""
    if is_dumped(name):
        sys.stderr.write(f"-- after {name} --\n{listing(program)}\n")
    return verified(program, f"after {name}")


def is_dumped(name: str) -> bool:
    """Returns whether the environment asks for the program after a pass."""
    return os.environ.get("TEG_DUMP", "") in ("all", name)


def normal_form(
    e: Expr,
    keep_moving: bool = False,
    maps: Maps = (),
    canonical: Canonical | None = None,
    remarks: Remarks | None = None,
    whole: bool = False,
) -> Expr:
    """Returns e with canonical atoms, split integrals, and no δ.

    With `keep_moving`, those deltas stay that are carried along when e is differentiated again. Decisions are added to `remarks`. With
    `whole`, integrals are not divided where nothing jumps, for estimators that treat every condition as an edge.
    """
    canonical = canonical or Canonical()
    e = run_passes(to_atoms(keep_moving, maps, canonical, whole), e)
    if not e.has_delta:
        return e
    e = run_passes(eliminations(keep_moving, maps, canonical, remarks), e)
    names = {p.name for p in parameters(e)}
    clashing = {n.var for n in postorder([e]) if isinstance(n, Integral) and n.var.name in names}  # "s" is the variable of a chart
    return cast(Expr, rename_apart(e, clashing)) if clashing else e


def diff(e: object, by: Param | Var, maps: Maps = ()) -> Expr:
    """Returns the derivative of e by a parameter or a free variable, deltas visible. A δ in e is eliminated first. A tuple is
    differentiated entry by entry."""
    return jvp(e, {by: ONE}, maps)


def jvp(e: object, direction: Mapping[Param | Var, object], maps: Maps = ()) -> Expr:
    """Returns the directional derivative Σ ∂e/∂p · direction[p] (forward mode), deltas visible; p may be a free variable of e."""
    if not isinstance(direction, Mapping):
        raise ParameterError("a direction is a dict parameter -> change", None, "write teg.jvp(e, {t: 1})")
    variables = [p for p in direction if isinstance(p, Var)]
    check_parameters([p for p in direction if not isinstance(p, Var)])
    changes = {p: as_number(v) for p, v in direction.items()}
    whole = apart_from(_expression(e), variables)
    normal = _ready(normal_form(whole, keep_moving=True, maps=maps), list(changes))
    return MissedCuts(normal).checked(run_pass("differentiate", lambda u: tangent_of(u, changes), normal), list(changes))


def grad(e: object, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """Returns the derivatives of e by each parameter (reverse mode; default: all), a tuple, deltas visible. For a tuple e: a tuple of
    these."""
    wrt = _chosen(e, by)
    normal = _ready(normal_form(_expression(e), keep_moving=True, maps=maps), wrt)
    return cast(Tuple, MissedCuts(normal).guarded(run_pass("adjoint", lambda u: gradient_of(u, wrt), normal), wrt))


def hessian(e: object, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """Returns the matrix of second derivatives of e, a tuple of tuples, with the deltas of the second differentiation visible."""
    wrt = _chosen(e, by)
    return grad(grad(e, wrt, maps), wrt, maps)


def eliminate(e: object, maps: Maps = ()) -> Expr:
    """Returns e without δ: each is reduced to one variable and sifted, with the user's maps if they help."""
    return normal_form(_expression(e), maps=maps)


def estimator_for(discontinuities: str, options: Mapping[str, object] | None = None, how: Integration | None = None) -> Estimator:
    """Returns the estimator of a name with these options, fitted to an integration. Raises OptionError for an unknown name or option."""
    name = ALIASES.get(discontinuities, discontinuities) if isinstance(discontinuities, str) else ""
    if name not in ESTIMATORS:
        raise OptionError(f"discontinuities={discontinuities!r} is not known", None, "one of: " + ", ".join([*ESTIMATORS, *ALIASES]))
    estimator = ESTIMATORS[name].with_options(options or {})
    return estimator if how is None else estimator.fitted(how)


class Elimination(NamedTuple):
    """How δ are eliminated: by which maps of the user's, and whether boundary terms may have closed forms; `remarks` take decisions."""

    maps: Maps = ()
    closed_forms: bool = True
    remarks: Remarks | None = None


PLAIN = Elimination()
"""By the families of the compiler alone."""


class Begun(NamedTuple):
    """The normal form of a program, and what was met on the way: derivations of values and derivatives begin with it."""

    normal: Expr
    canonical: Canonical


def begun(e: Expr, elimination: Elimination = PLAIN) -> Begun:
    """Returns the beginning of derivations of a program."""
    canonical = Canonical()
    return Begun(normal_form(write_out(e), maps=elimination.maps, canonical=canonical, remarks=elimination.remarks), canonical)


def compiled_outputs(
    e: Expr,
    wrt: Sequence[Param],
    orders: int,
    estimator: Estimator,
    elimination: Elimination = PLAIN,
    beginning: Begun | None = None,
) -> list[Expr]:
    """Returns [value], [value, gradient], or [value, gradient, Hessian], without δ and in canonical form, ready to be lowered together.

    Several derivations of one program may share their beginning.
    """
    maps, closed_forms, remarks = elimination
    if not estimator.has_all_orders and orders:
        return _estimated_outputs(e, wrt, orders, estimator, maps)
    e, families, sifted = write_out(e), families_with(maps), isinstance(estimator, Exact)
    last_families = closing(families, boundary_terms(remarks)) if closed_forms else families
    eliminate = partial(eliminate_deltas, remarks=remarks, written=deltas_of(e))
    estimate = partial(eliminate, families=last_families) if sifted else ignore_discontinuities
    normal, canonical = begun(e, elimination) if beginning is None else (beginning.normal, beginning.canonical.copied())
    outputs = [normal]  # canonical nodes are met again at the end
    source = normal_form(e, True, maps, canonical, remarks) if e.has_delta else outputs[0]
    missed = MissedCuts(source if sifted else ZERO)
    for order in range(orders):
        source = _ready(source, wrt) if sifted else without_uncounted(source, wrt)
        raw: Expr = run_pass("adjoint", partial(gradient_of, wrt=wrt), source)
        last = order + 1 == orders
        if sifted:
            raw = run_pass("finite bounds", partial(with_finite_bounds, endless=is_endless), raw)
        if not last and sifted:  # deltas that are carried along are eliminated beside, not before, the next derivative
            raw = run_pass("eliminate", partial(eliminate, keep_moving=True, families=families), raw)
        outputs.append(run_pass(estimator.name, estimate, raw))
        if not last:
            source = run_pass("canonicalise", canonical, raw if sifted else outputs[-1])
        outputs[-1] = missed.guarded(outputs[-1], wrt, again=order > 0)
    return _together(outputs, canonical)


def _estimated_outputs(e: Expr, wrt: Sequence[Param], orders: int, estimator: Estimator, maps: Maps) -> list[Expr]:
    """Returns [value, gradient] for an estimator that is a pass over the whole program."""
    name = estimator.name
    if orders > 1:
        raise EstimatorError(f"discontinuities={name!r} gives first derivatives only", None, '"exact" and "ignore" give any order')
    if e.has_delta:
        hint = 'discontinuities="exact" moves it with its surface'
        raise EstimatorError(f"discontinuities={name!r} does not differentiate a program with a delta", e, hint)
    if maps:
        raise EstimatorError(
            f"discontinuities={name!r} uses no maps", None, "teg.change_variables(e, m) changes the variables of a program"
        )
    canonical = Canonical()
    value = normal_form(write_out(e), canonical=canonical, whole=True)
    gradient = run_pass(name, partial(estimator.gradient, wrt=wrt), _ready(value, wrt))
    return [*_together([value], canonical), gradient]  # not canonical: integrals would be split into terms, and their errors added


def _together(outputs: Sequence[Expr], canonical: Canonical) -> list[Expr]:
    """Returns the outputs in canonical form: one surface is one expression, so that they share loops."""
    centred_outputs = [run_pass("centre", centred, released(output)) for output in outputs]
    together = run_pass("exponents", with_common_exponents, simplify.tuple_of(*centred_outputs))
    return list(cast(Tuple, run_pass("canonicalise", canonical, together)).children)


def flat_program(
    outputs: Sequence[Expr],
    names: Sequence[str],
    how: Integration,
    remarks: Remarks | None = None,
    about: About = ABOUT_NOTHING,
) -> Program:
    """Returns the flat program of outputs without δ, before the passes over flat programs. Decisions are added to `remarks`."""
    outputs, differentiated = ([released(e) for e in several] for several in (outputs, about.differentiated))
    return checked("lower", schedule(outputs, names, how, intrinsics_for(how), remarks, replace(about, differentiated=differentiated)))


def finished(program: Program, errors: bool = False) -> Program:
    """Returns the program after the passes over flat programs."""
    for name, step in to_finished(errors):
        before, program = program, step(program)
        if program is not before or is_dumped(name):
            program = checked(name, program)
    return program


def program_for(
    outputs: Sequence[Expr],
    names: Sequence[str],
    how: Integration,
    errors: bool = False,
    remarks: Remarks | None = None,
    about: About = ABOUT_NOTHING,
) -> Program:
    """Returns the finished program of outputs without δ; with `errors`, an estimate of the error of each follows them."""
    return finished(flat_program(outputs, names, how, remarks, replace(about, intervals=not errors)), errors)


def _expression(e: object) -> Expr:
    return e if isinstance(e, Tuple) else as_number(e)


def apart_from(e: Expr, variables: Sequence[Var]) -> Expr:
    """Returns the expression with other variables in the integrals over these. Raises ScopeError for a variable that is only bound in e."""
    if not variables:
        return e
    for v in variables:
        if v not in e.free and any(isinstance(n, Integral) and n.var is v for n in postorder([e])):
            hint = "the derivative by a variable stands inside of its integral: teg.integral(teg.diff(e, x), (x, 0, 1))"
            raise ScopeError(f"{v.name} is integrated over, so nothing depends on it", e, hint)
    return cast(Expr, rename_apart(e))


def _ready(e: Expr, wrt: Sequence[Param | Var]) -> Expr:
    """Returns a normal form ready to be differentiated: NaN where too many steps move, an error where no steps can be written out; moving
    poles at rest."""
    e = without_uncounted(e, wrt)
    check_steps(e, wrt)
    return run_pass("around poles", partial(around_poles, wrt=wrt), e)


def _chosen(e: object, by: Sequence[Param] | Param | None) -> list[Param]:
    return parameters(_expression(e)) if by is None else check_parameters(by)


def flatten(e: Expr) -> list[Expr]:
    """Returns the entries of nested tuples, in order."""
    flat: list[Expr] = []
    stack = [e]
    while stack:
        node = stack.pop()
        if isinstance(node, Tuple):
            stack.extend(reversed(node.children))
        else:
            flat.append(node)
    return flat
