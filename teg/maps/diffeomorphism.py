"""Diffeomorphisms: changes of variables with their inverse, domain and Jacobian, verified when they are made and when they are used.

    x = forward(u),  u = inverse(x),  dx = |J| du,  J = det ∂forward/∂u          old variables x, new variables u in the domain

Verified at sample points of the domain: inverse(forward(u)) = u; J is not NaN, not 0 and of one sign; a given J is the derived one. This
happens for sample values of the parameters when the map is made, and for the actual values in every call of a function compiled with it.
A map that is wrong in a corner smaller than the gaps between the points passes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.calculus import slope
from teg.analysis.evaluate import folded
from teg.analysis.intervals import Interval, enclose
from teg.errors import BoundError, NameClashError, OperandError, OptionError, ParameterError, ScopeError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Const, Expr, Param, Var, const
from teg.ir.operands import as_number
from teg.ir.simplify import add, integer_power, mul, positive, sub, where
from teg.ir.traverse import fresh, parameters, substitute
from teg.maps.identities import sign_of, simplified
from teg.maps.verification import SAMPLES, TOLERANCE, TRIALS, Constraint, verify
from teg.symbolic import jacobian_determinant

INFINITY, MINUS_INFINITY = const(math.inf), const(-math.inf)


class Diffeomorphism:
    """A smooth invertible map from new variables to old ones, for `teg.change_variables` and `teg.compile(maps=…)`.

        r, p = teg.vars("r p")
        m = teg.Diffeomorphism({x: r*teg.cos(p), y: r*teg.sin(p)}, inverse={r: teg.sqrt(x*x + y*y), p: teg.atan2(y, x)},
                               domain={r: (0, None), p: (-math.pi, math.pi)})

        forward:  dict old variable -> expression of the new variables and of parameters.
        inverse:  dict new variable -> expression of the old variables and of parameters; the first one is innermost in the new integrals.
        domain:   dict new variable -> (lower, upper), an open interval where the map is one-to-one; None, or no entry, is unbounded.
                  Numbers or expressions of parameters.
        jacobian: the determinant ∂forward/∂new, or its absolute value; derived if it is not given.
        bounds:   dict new variable -> (lower, upper), finite: a box that contains the image of every integral the map is used for. Needed
                  only where it cannot be derived.
        check_at: dict parameter (or its name) -> number, the values at which the map is verified now; default: some between 0.4 and 1.4.
                  Parameters of the integrals that the map is for may be among them.

    `m1 @ m2` (the same as `m1.then(m2)`) is the map through the new variables of m1, which are old ones of m2; `m.inverse_map()` is the
    inverse. Maps are immutable, compared by identity, and pickle.

    Raises DiffeomorphismError if the map is not a diffeomorphism, with a point and the two values that should agree; ScopeError and
    NameClashError for wrong variables and names.
    """

    __slots__ = ("bounds", "check_at", "domain", "forward", "image", "inverse", "jacobian", "orientation", "reference", "within")

    forward: Mapping[Var, Expr]
    inverse: Mapping[Var, Expr]
    domain: Mapping[Var, Interval]
    jacobian: Expr
    bounds: Mapping[Var, Interval]
    check_at: Mapping[Param, float]
    within: tuple[Constraint, ...]  # constraints of composed and inverse maps
    image: Mapping[Var, Interval]  # the values of the old variables, as far as they are known
    reference: Mapping[Var, Expr]  # a point of the domain
    orientation: Expr  # the sign of J: 1, -1, or an expression of parameters

    def __init__(
        self,
        forward: Mapping[Var, object],
        inverse: Mapping[Var, object],
        domain: Mapping[Var, tuple[object, object]] | None = None,
        jacobian: object = None,
        bounds: Mapping[Var, tuple[object, object]] | None = None,
        *,
        check_at: Mapping[Any, float] | None = None,
    ) -> None:
        new, old = _variables(inverse, "inverse"), _variables(forward, "forward")
        if len(new) != len(old) or set(new) & set(old):
            raise ScopeError(
                f"{len(old)} old variables, {_names(old)}, and {len(new)} new ones, {_names(new)}",
                None,
                "give as many new variables as old ones, with other names; variables that stay the same need no entry",
            )
        self._set("forward", {v: _smooth(e, new, f"forward[{v.name}]") for v, e in forward.items()})
        self._set("inverse", {v: _smooth(e, old, f"inverse[{v.name}]") for v, e in inverse.items()})
        stated = _intervals(domain, new, "domain")
        self._set("domain", {v: stated.get(v, (MINUS_INFINITY, INFINITY)) for v in new})
        self._set("bounds", _finite(_intervals(bounds, new, "bounds"), self.domain))
        self._set("within", ())
        self._set("image", {v: _values_of(e, self.domain) for v, e in self.forward.items()})
        self._set("reference", {v: _inner_point(*pair) for v, pair in self.domain.items()})
        self._set("orientation", ONE)
        self._set(
            "jacobian",
            simplified(jacobian_determinant(self.forward, new), self.domain) if jacobian is None else _smooth(jacobian, new, "jacobian"),
        )
        if clash := {p.name for p in self.parameters} & {v.name for v in (*old, *new)}:
            raise NameClashError(
                f"a parameter and a variable of the map have one name: {', '.join(sorted(clash))}", None, "rename one of them"
            )
        self._set("check_at", _check_values(check_at, self.parameters))
        for trial in range(TRIALS):
            self.verify(self.sample_values(self.parameters, trial), derive=jacobian is not None)
        sign = self.sign_of(self.jacobian)
        self._set("orientation", ONE if sign is None else sign)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a map is immutable: cannot set {name!r}")

    def __reduce__(self) -> tuple[object, ...]:
        return (_restored, tuple(getattr(self, name) for name in self.__slots__))

    def __repr__(self) -> str:
        return "<teg.Diffeomorphism " + ", ".join(f"{v.name} = {e}" for v, e in self.forward.items()) + ">"

    @property
    def old(self) -> tuple[Var, ...]:
        """Returns the variables that are replaced.

        teg.polar(x, y, r, p).old == (x, y)             # True
        """
        return tuple(self.forward)

    @property
    def new(self) -> tuple[Var, ...]:
        """Returns the variables that replace them, innermost first.

        teg.polar(x, y, r, p).new == (r, p)             # True
        """
        return tuple(self.inverse)

    @property
    def parameters(self) -> tuple[Param, ...]:
        """Returns every parameter in the map, in order of first appearance.

        teg.maps.scaling(x, u, t).parameters == (t,)    # True
        """
        ends = (e for pairs in (self.domain, self.bounds) for pair in pairs.values() for e in pair)
        conditions = (e for c in self.within for e in c)
        return tuple(parameters(*self.forward.values(), *self.inverse.values(), self.jacobian, *ends, *conditions))

    # -- other maps ----------------------------------------------------------------------------------------------------

    def then(self, other: Diffeomorphism) -> Diffeomorphism:
        """Returns this map followed by `other` for some or all of its new variables: the same as changing variables twice.

            m = teg.maps.translation(x, u, 1).then(teg.maps.scaling(u, v, 2))
            str(m)                                          # <teg.Diffeomorphism x = 2·v + 1>

        Raises OperandError for an argument that is no map, ScopeError for old variables that are not new ones of this map.
        """
        if not isinstance(other, Diffeomorphism):
            raise OperandError(f"a map is composed with a map, not with {type(other).__name__}")
        if not set(other.old) <= set(self.new) or set(other.new) & {*self.old, *self.new}:
            raise ScopeError(
                f"the second map replaces {_names(other.old)} by {_names(other.new)}, the first one ends in {_names(self.new)}",
                None,
                "the old variables of the second are new ones of the first, and its new ones are in neither",
            )
        onward, back = dict(other.forward), dict(self.inverse)
        kept = [v for v in self.new if v not in onward]
        own, left = other._domain_under(self.domain)
        domain = {**own, **{v: self.domain[v] for v in kept}}
        known: dict[Var, Expr] = {**other.inverse, **{v: v for v in kept}}
        fixed = dict(self.reference)
        return _derived(
            forward={x: _into(e, onward, domain) for x, e in self.forward.items()},
            inverse={u: _into(e, back) for u, e in known.items()},
            domain=domain,
            jacobian=simplified(mul(_into(self.jacobian, onward), other.jacobian), domain),
            orientation=mul(self.orientation, other.orientation),
            reference={u: _into(e, fixed) for u, e in known.items()},
            image=self.image,
            bounds={**dict(other.bounds), **{v: b for v, b in self.bounds.items() if v in kept}},
            within=(
                *(Constraint(_into(c.value, onward), c.lo, c.hi) for c in self.within),
                *left,
                *other.within,
            ),
            check_at={**dict(other.check_at), **dict(self.check_at)},
        )

    def _domain_under(self, outer: Mapping[Var, Interval]) -> tuple[dict[Var, Interval], list[Constraint]]:
        """Returns the domain, restricted by the domains of the old variables, and the restrictions that are not intervals of a new
        variable."""
        domain = dict(self.domain)
        left: list[Constraint] = []
        for v, e in self.forward.items():
            (u, *others) = e.free
            sign = self.sign_of(slope(e, u)) if not others and self.inverse[u].free == {v} else None
            remaining = list(outer[v])
            for i in range(2) if isinstance(sign, Const) else ():
                k = i if sign is ONE else 1 - i  # the end of u that corresponds to end i of v
                if _is_finite(outer[v][i]) and not _is_finite(domain[u][k]):
                    end = folded(simplified(cast(Expr, substitute(self.inverse[u], {v: outer[v][i]}))))
                    domain[u] = (end, domain[u][1]) if k == 0 else (domain[u][0], end)
                    remaining[i] = (MINUS_INFINITY, INFINITY)[i]
            if any(_is_finite(end) for end in remaining):
                left.append(Constraint(e, *remaining))
        return domain, left

    def __matmul__(self, other: object) -> Diffeomorphism:
        return self.then(cast(Diffeomorphism, other))

    def inverse_map(self) -> Diffeomorphism:
        """Returns the inverse map: its new variables are the old ones of this map.

        str(teg.maps.scaling(x, u, 2).inverse_map())    # <teg.Diffeomorphism u = 0.5·x>
        """
        reciprocal = integer_power(_into(self.jacobian, self.inverse), -1)
        return _derived(
            forward=self.inverse,
            inverse=self.forward,
            domain=self.image,
            jacobian=reciprocal,
            orientation=self.orientation,
            reference={x: _into(e, self.reference) for x, e in self.forward.items()},
            image=self.domain,
            bounds={},
            within=tuple(Constraint(e, *self.domain[u]) for u, e in self.inverse.items()),
            check_at=self.check_at,
        )

    def with_bounds(self, bounds: Mapping[Var, tuple[object, object]]) -> Diffeomorphism:
        """Returns the same map with a box that contains the image of every integral it is used for.

            m = teg.polar(x, y, r, p).with_bounds({r: (0, 2), p: (-math.pi, math.pi)})

        Raises ScopeError for bounds that are no interval of a new variable, BoundError for bounds that are infinite or reach beyond the
        domain.
        """
        parts = {name: getattr(self, name) for name in self.__slots__}
        return _derived(**{**parts, "bounds": _finite(_intervals(bounds, self.new, "bounds"), self.domain)})

    def renamed(self, taken: Iterable[str]) -> Diffeomorphism:
        """Returns the same map with new variables whose names are not among those in `taken`.

        str(teg.maps.scaling(x, u, 2).renamed(["u"]))   # <teg.Diffeomorphism x = 2·u′>
        """
        names = set(taken)
        change: dict[Var, Expr] = {}
        for v in self.new:
            change[v] = fresh(v.name, (Var.make(n, ()) for n in names))
            names.add(cast(Var, change[v]).name)
        if all(a is b for a, b in change.items()):
            return self

        def by_name(entries: Mapping[Var, Any]) -> dict[Var, Any]:
            return {cast(Var, change[v]): e for v, e in entries.items()}

        return _derived(
            forward={x: _into(e, change) for x, e in self.forward.items()},
            inverse=by_name(self.inverse),
            domain=by_name(self.domain),
            jacobian=_into(self.jacobian, change),
            orientation=self.orientation,
            reference=by_name(self.reference),
            image=self.image,
            bounds={v: (_into(lo, change), _into(hi, change)) for v, (lo, hi) in by_name(self.bounds).items()},
            within=tuple(Constraint(_into(c.value, change), c.lo, c.hi) for c in self.within),
            check_at=self.check_at,
        )

    # -- signs ---------------------------------------------------------------------------------------------------------

    def sign_of(self, e: Expr) -> Expr | None:
        """Returns the sign of an expression of the new variables that does not vanish in the domain: 1, -1, or an expression of parameters.

        str(teg.polar(x, y, r, p).sign_of(-r))          # -1
        """
        if by_form := sign_of(e, {}):
            return ONE if by_form > 0 else MINUS_ONE
        there = _into(e, self.reference)
        if isinstance(there, Const):
            return ONE if there.data > 0.0 else MINUS_ONE if there.data < 0.0 else None
        return where(positive(there), ONE, MINUS_ONE)

    def weight(self) -> Expr:
        """Returns |J|, the factor that an integral in the new variables has.

        str(teg.polar(x, y, r, p).weight())             # r
        """
        return mul(self.orientation, self.jacobian)

    def sample_values(self, known: Sequence[Param], trial: int) -> dict[Param, float]:
        """Returns parameter values for verifying a map: those of `check_at`, and others between 0.4 and 1.4, no two in a simple ratio.

        m = teg.Diffeomorphism({x: t * u}, inverse={u: x / t}, check_at={t: 2.0})
        m.sample_values([t], 0)[t]                      # 2.0
        """
        golden = 0.6180339887498949
        return {p: self.check_at.get(p, 0.4 + math.modf((TRIALS * i + trial + 1) * golden)[0]) for i, p in enumerate(known)}

    def verify(self, values: Mapping[Param, Any], samples: int = SAMPLES, derive: bool = False) -> None:
        """Checks the map at parameter values (numbers, or arrays of one length). Raises DiffeomorphismError.

            teg.maps.scaling(x, u, t).verify({t: 3.0})

        `samples` is the number of points; with `derive` the Jacobian is compared with the determinant of the derivatives, too.
        """
        verify(self, values, samples, derive)


def checked_maps(maps: object) -> tuple[Diffeomorphism, ...]:
    """Returns the list of maps a user gives as a tuple; raises OptionError for anything else."""
    if not isinstance(maps, list | tuple) or not all(isinstance(m, Diffeomorphism) for m in maps):
        raise OptionError(f"maps={maps!r:.80} is not a list of maps", None, "maps=[m] with an m made by teg.Diffeomorphism or in teg.maps")
    return tuple(maps)


def _derived(**parts: Any) -> Diffeomorphism:
    """Returns a map made of verified maps."""
    return _restored(*(parts[name] for name in Diffeomorphism.__slots__))


def _restored(*parts: Any) -> Diffeomorphism:
    m = object.__new__(Diffeomorphism)
    for name, value in zip(Diffeomorphism.__slots__, parts, strict=True):
        object.__setattr__(m, name, value)
    return m


def _into(e: Expr, mapping: Mapping[Var, Expr], box: Mapping[Var, Interval] | None = None) -> Expr:
    return simplified(cast(Expr, substitute(e, mapping)), box)


def _names(variables: Iterable[Var]) -> str:
    return ", ".join(v.name for v in variables)


def _variables(entries: Mapping[Var, object], what: str) -> list[Var]:
    if not isinstance(entries, Mapping) or not entries:
        raise ScopeError(f"{what} is a dict variable -> expression, not {entries!r:.80}", None, "write {x: r*teg.cos(p), y: r*teg.sin(p)}")
    for v in entries:
        if not isinstance(v, Var):
            raise ScopeError(f"the keys of {what} are variables of integration", v, 'make one with x = teg.var("x")')
    return list(entries)


def _smooth(value: object, allowed: Sequence[Var], what: str) -> Expr:
    """Returns an expression that may be a part of a map, with functions written out. Raises an error for other values."""
    e = write_all_out(as_number(value))
    if e.has_delta or e.has_integral:
        raise OperandError(f"{what} holds {'a delta' if e.has_delta else 'an integral'}", e, "a map is made of functions")
    if e.free - set(allowed):
        raise ScopeError(
            f"{what} depends on {_names(sorted(e.free - set(allowed), key=lambda v: v.name))}", e, f"it may use {_names(allowed)}"
        )
    return e


def _intervals(pairs: Mapping[Var, tuple[object, object]] | None, new: Sequence[Var], what: str) -> dict[Var, Interval]:
    """Returns checked (lower, upper) pairs; None is infinite."""
    intervals: dict[Var, Interval] = {}
    for v, pair in (pairs or {}).items():
        if v not in new or not isinstance(pair, tuple | list) or len(pair) != 2:
            raise ScopeError(
                f"{what}[{v}] = {pair!r:.80} is not an interval of a new variable", None, f"a dict of {_names(new)} -> (lower, upper)"
            )
        allowed = new[new.index(v) + 1 :] if what == "bounds" else ()
        lo = MINUS_INFINITY if pair[0] is None else _smooth(pair[0], allowed, what)
        hi = INFINITY if pair[1] is None else _smooth(pair[1], allowed, what)
        intervals[v] = lo, hi
    return intervals


def _finite(bounds: dict[Var, Interval], domain: Mapping[Var, Interval]) -> dict[Var, Interval]:
    """Returns bounds that are finite, and inside the domain as far as both are numbers."""
    for v, (lo, hi) in bounds.items():
        if any(isinstance(end, Const) and not math.isfinite(end.data) for end in (lo, hi)):
            raise BoundError(f"bounds[{v.name}] are not finite", None, "give the box that the image of the integrals lies in")
        for first, second in ((domain[v][0], lo), (hi, domain[v][1])):
            if isinstance(first, Const) and isinstance(second, Const) and first.data > second.data + TOLERANCE:
                raise BoundError(
                    f"bounds[{v.name}] = ({lo}, {hi}) reach beyond its domain ({domain[v][0]}, {domain[v][1]})",
                    None,
                    "the map is one-to-one in its domain only: beyond it, points would count twice",
                )
    return bounds


def _check_values(given: Mapping[Any, float] | None, known: Sequence[Param]) -> dict[Param, float]:
    names = {p.name: p for p in known}
    numbers: dict[Param, float] = {}
    for k, v in (given or {}).items():
        if not isinstance(k, Param) and k not in names:
            raise ParameterError(
                f"check_at names {k!r}, which is not a parameter of the map", None, f"parameters: {', '.join(names) or 'none'}"
            )
        numbers[k if isinstance(k, Param) else names[k]] = float(v)
    return numbers


def _is_finite(end: Expr) -> bool:
    return end is not INFINITY and end is not MINUS_INFINITY


def _values_of(e: Expr, domain: Mapping[Var, Interval]) -> Interval:
    """Returns bounds of the values of an expression as numbers; infinite if they are not known."""
    sign = sign_of(e, domain)
    lo, hi = enclose(e, domain)
    return (
        lo if isinstance(lo, Const) and math.isfinite(lo.data) else ZERO if sign > 0 else MINUS_INFINITY,
        hi if isinstance(hi, Const) and math.isfinite(hi.data) else ZERO if sign < 0 else INFINITY,
    )


def _inner_point(lo: Expr, hi: Expr) -> Expr:
    """Returns a point between two bounds that divides them in no simple fraction."""
    if lo is MINUS_INFINITY:
        return const(0.4375) if hi is INFINITY else sub(hi, ONE)
    return add(lo, ONE) if hi is INFINITY else add(lo, mul(const(0.4375), sub(hi, lo)))
