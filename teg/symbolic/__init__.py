"""To SymPy and back, and Jacobians that SymPy simplifies. `teg.symbolic.writer` writes this table, `teg.symbolic.reader` reads it.

    c                        Integer, or Float of 53 bits, oo, nan: no bit is lost
    p, x                     Symbol(name, real=True)
    √u, root(u)              u^(1/2), |u|^(1/2)
    [g > 0], [g >= 0]        Heaviside(g, 0), Heaviside(g, 1): the second argument is the value where g = 0
    where(c, a, 0)           a·Heaviside(…)·…, if a is finite everywhere and c is atoms joined by &
    where(c, a, b)           Abs, sign, Min, Max if it is one of these, else Piecewise((a, c), (b, True))
    ∫ₗʰ e dx, δ(g)           Integral(e, (x, l, h)), DiracDelta(g)

Both directions are iterative and linear: a shared node is converted once. SymPy's constructors are bypassed, because they traverse all
of an expression written out. SymPy's own functions do not know sharing: printing, comparing or simplifying a shared expression costs as
much as the written-out one, and an expression some hundred nodes deep ends in Python's RecursionError.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.calculus import slope
from teg.errors import OperandError, OptionError, ParameterError, TegError
from teg.ir import expr as ex
from teg.ir import operands, simplify
from teg.ir.expr import ONE, ZERO, Cond, Expr, Param, Tuple, Var
from teg.ir.traverse import size, substitute
from teg.language import programs
from teg.symbolic.nodes import sympy_package
from teg.symbolic.reader import Reader, names_of, readable
from teg.symbolic.writer import Writer, symbols_of, written_out

CONDITIONS = ("auto", "heaviside", "piecewise")

_WRITTEN_OUT = 2000  # largest number of nodes given to SymPy's constructors,
_OPERATIONS = 150  # and of operations given to its simplifiers: about a second each


def to_sympy(e: object, *, evaluate: bool = False, conditions: str = "auto", symbols: Mapping[Any, Any] | None = None) -> Any:
    """Returns the SymPy form of an expression, a tuple or a condition. Its values are the same, on borders as well.

        str(teg.to_sympy(teg.bracket(x < t) * teg.exp(x)))  # exp(x)*Heaviside(t - x, 0)

        evaluate:   False writes the expression as it is. True goes through SymPy's constructors, which collect and sort terms, so that ==
                    with other SymPy expressions means something; they round anew, and are for short expressions.
        conditions: "auto" is the table. "heaviside" writes every condition by Heavisides, so that `sympy.diff` sees all jumps, but branches
                    not taken must then be finite. "piecewise" uses no Heaviside, which `sympy.integrate` prefers.
        symbols:    other symbols for some parameters and variables.

    Functions of `teg.function` are written out. The resolution of ties, which only the compiler uses, is left out. Raises NameClashError
    if a parameter and a variable have one name, OptionError for an expression too long for evaluate=True, OperandError for a node
    without a form in SymPy, MissingPackageError without SymPy.
    """
    root = write_all_out(e if isinstance(e, Cond | Tuple) else operands.as_number(e))
    if conditions not in CONDITIONS:
        raise OptionError(f"conditions={conditions!r} is not one of {', '.join(CONDITIONS)}")
    if evaluate and written_out(root) > _WRITTEN_OUT:
        raise OptionError(f"written out, the expression has more than {_WRITTEN_OUT} nodes", root, "leave evaluate=False")
    for node, symbol in (symbols or {}).items():
        if not isinstance(node, Param | Var) or not isinstance(symbol, sympy_package().Symbol):
            raise ParameterError("symbols= gives SymPy symbols for parameters and variables", node)
    named = symbols_of(root, symbols or {})
    try:
        return Writer(named, evaluate, conditions).write(root)
    except Exception as error:  # of any kind: SymPy has no common class for the failures of its constructors
        if not evaluate or isinstance(error, TegError):
            raise
        raise OptionError(f"SymPy cannot evaluate this: {error}", root, "leave evaluate=False") from error


def from_sympy(s: Any, variables: Iterable[Any] = (), *, heaviside_at_zero: float | None = None) -> Any:
    """Returns the expression of a SymPy form: a number, an expression, a condition, a tuple, or a matrix (the tuple of its rows).

        s = sympy.Symbol("s")
        str(teg.from_sympy(sympy.Integral(sympy.cos(s) * sympy.Symbol("t"), (s, 0, 1))))  # ∫[s: 0..1] t·cos(s)

    A symbol that an `Integral` binds becomes a variable. Other symbols become parameters. Those in `variables` (symbols, variables,
    names, or one string of names) become variables instead and stay free, for `teg.integral` to bind. A bound symbol whose name is taken
    gets a prime.

    Heaviside(u), ½ at 0 for SymPy, becomes the bracket [u > 0] if u depends on a variable and no DiracDelta is present: under an
    integral the value at 0 does not matter then. Elsewhere it is ½ at 0. A number `heaviside_at_zero` replaces this rule. Where no
    condition of a Piecewise holds its value is NaN, as in SymPy. Numbers are rounded to the nearest float64; fractions stay quotients.

    Raises OperandError for a node that the language does not have, with SymPy's expression as `where`; BoundError for integrals without
    two finite bounds; NameClashError for two symbols of one name; MissingPackageError without SymPy.
    """
    sympy = sympy_package()
    if isinstance(s, Expr | Cond | str):
        raise OperandError("from_sympy takes SymPy's expressions", s, "sympy.sympify reads text")
    try:
        root = sympy.Tuple(*(sympy.Tuple(*row) for row in s.tolist())) if isinstance(s, sympy.MatrixBase) else sympy.sympify(s)
        root = sympy.Tuple(*root) if isinstance(root, list | tuple) else root
    except (sympy.SympifyError, TypeError, AttributeError) as error:
        raise OperandError(f"{type(s).__name__} is not an expression of SymPy: {s!r:.80}") from error
    if isinstance(variables, str):
        variables = variables.replace(",", " ").split()
    chosen = [variables] if isinstance(variables, Var | sympy.Symbol) else list(variables)
    if not all(isinstance(v, str | Var | sympy.Symbol) for v in chosen):
        raise ParameterError("variables= takes symbols, variables or names", chosen)
    wanted = frozenset(v if isinstance(v, str) else cast(str, v.name) for v in chosen)
    order = readable(root)
    at_zero = 0.5 if heaviside_at_zero is None and any(type(n) is sympy.DiracDelta for n in order) else heaviside_at_zero
    bound, names = names_of(order, wanted, frozenset())
    result = Reader(names, at_zero).read(order)
    outside = frozenset(x for x in bound if names[x] in result.free and x.name not in wanted)
    if not outside:
        return result
    _, names = names_of(order, wanted, outside)  # a symbol is bound in one place and free in another: ∫₀ˣ f(x) dx
    places = {cast(Var, names[x]): cast(Expr, programs.param_of_any_name(x.name)) for x in outside}
    return substitute(Reader(names, at_zero, frozenset(places)).read(order), places)


def jacobian_determinant(forward: Mapping[Var, Expr], variables: Sequence[Var]) -> Expr:
    """Returns det ∂forward/∂variables: of x = r·cos(p), y = r·sin(p) by (r, p) it is r.

    Rows are in the order of `forward`, columns in that of `variables`. The compiler differentiates, with the conditions of branches as
    constants; SymPy expands the determinant and simplifies it, with numbers as exact fractions. The compiler's own expansion is returned
    if the determinant is too long for SymPy or holds integrals, SymPy fails or is not installed, or its result is longer. Raises
    ParameterError if the numbers of coordinates and variables differ, NotDifferentiableError for floor and mod of a variable.
    """
    if len(forward) != len(variables) or not variables:
        raise ParameterError(f"a Jacobian of {len(forward)} coordinates by {len(variables)} variables has no determinant")
    rows = [[slope(e, v) for v in variables] for e in forward.values()]
    plain = _expanded_determinant(rows)
    entries = simplify.tuple_of(*(e for row in rows for e in row))
    if size(plain) == 1 or entries.has_integral or written_out(entries) > _WRITTEN_OUT:
        return plain
    try:
        simple = _simplified_determinant(rows, entries)
    except Exception:  # of any kind: SymPy has no common class for the failures of its simplifiers, and the result is known without them
        return plain
    return simple if simple is not None and size(simple) <= size(plain) else plain


def _expanded_determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Returns the determinant, expanded row by row over sets of columns: products share common parts, zeros cost nothing."""
    minors: dict[frozenset[int], Expr] = {frozenset(): ONE}
    for row in rows:
        terms: dict[frozenset[int], list[Expr]] = {}
        for taken, minor in minors.items():
            for column, entry in enumerate(row):
                if column not in taken and entry is not ZERO:
                    sign = -1.0 if sum(c > column for c in taken) % 2 else 1.0
                    terms.setdefault(taken | {column}, []).append(simplify.mul(ex.const(sign), minor, entry))
        minors = {columns: simplify.add(*parts) for columns, parts in terms.items()}
    return next(iter(minors.values()), ZERO)


def _simplified_determinant(rows: Sequence[Sequence[Expr]], entries: Tuple) -> Expr | None:
    sympy = sympy_package()
    symbols = symbols_of(entries, {})
    writer = Writer(symbols, evaluate=True, conditions="piecewise", exact=True)
    determinant = sympy.Matrix([[writer.write(e) for e in row] for row in rows]).det(method="berkowitz")
    if sympy.count_ops(determinant) > _OPERATIONS:
        return None
    names = {symbol: cast(Expr, node) for node, symbol in symbols.items()}
    return cast(Expr, Reader(names, None).read(readable(sympy.simplify(determinant))))
