"""Moments of hyperbolas in C: `Hyperbola` of `teg.program`; what they have in common is in runtime/hyperbola.h."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import comb

from teg.backends.c.frame import Frame, Scope
from teg.backends.c.text import indent, literal, packed, wrapped
from teg.numerics.moments import highest, moment, series
from teg.program import NO_FLUX, Hyperbola, Moments

Powers = tuple[int, int]
CHAINS = 4
"""Into how many sums a series is split, which are computed side by side."""
MIDDLES = ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5))


def along_a_branch(stmt: Hyperbola) -> tuple[Powers, ...]:
    """Returns the moments along branches that the results are made of."""
    wanted: set[Powers] = set()
    for m in stmt.moments:
        for j, k, _ in m.terms:
            wanted |= {(j, k)} if m.kind == "border" else {(j, k), (j, k + 1)}
    return tuple(sorted(wanted))


def function_name(moments: Sequence[Powers]) -> str:
    """Returns the name of the C function of some moments along a branch."""
    return "_".join(["teg_along", *(f"{j}{k}" for j, k in moments)])


def hyperbola(stmt: Hyperbola, frame: Frame) -> list[str]:
    """Returns the inside of a hyperbola's routine."""
    scope = frame.scope()
    count, along = len(stmt.results), along_a_branch(stmt)
    inside = sorted({(j, k) for m in stmt.moments if m.kind != "border" for j, k, _ in m.terms})
    borders = [i for i, m in enumerate(stmt.moments) if m.kind == "border"]
    single, fixed = count == 1, "" if stmt.ties else "const "

    def give(values: Sequence[str]) -> list[str]:
        return [f"return {values[0]};"] if single else packed(f"sum[{i}] = {value};" for i, value in enumerate(values))

    def leave(values: Sequence[str]) -> list[str]:
        return [*give(values), *([] if single else ["return;"])]

    turn = scope(stmt.turn)
    if stmt.ties and turn != "NAN":
        turn = f"settled ? NAN : {turn}"
    whole = [_polynomial(m, scope, None) for m in stmt.moments]
    places = {"above": "n_{}{}", "below": "rest_{}{}", "border": "m_{}{}"}
    found = [_polynomial(m, scope, places[m.kind]) for m in stmt.moments]
    kinds, chosen = [m.kind for m in stmt.moments], {"above": "teg_if(above, {})", "below": "teg_if(!above, {})", "border": "0.0"}
    lines = [
        *packed(f"{fixed}double f{i} = {scope(value)};" for i, value in enumerate(stmt.corners)),
        *(_settled(stmt, frame, scope) if stmt.ties else []),
        f"const int above = teg_above(f0, f1, f2, f3, {'ctx->order > 0 ? settled : 0' if stmt.ties else 0});",
        "if (above < 0) {",
        *indent(*leave(["NAN"] * count)),
        "}",
        "if (above == 0 || above == 15) {",
        *indent(*leave([chosen[kind].format(w) for w, kind in zip(whole, kinds, strict=True)])),
        "}",
        "teg_curve curve;",
        f"teg_trace(&curve, f0, f1, f2, f3, {turn}, above);",
        f"double along[{len(along)}] = {{0.0}};",
        f"for (int i = 0; i < curve.count; i++) {function_name(along)}(&curve.branches[i], along);",
        *packed(f"const double m_{j}{k} = along[{i}];" for i, (j, k) in enumerate(along)),
    ]
    for k in sorted({k for _, k in inside}):
        cut, one = _power("curve.cut", k + 1), repr(1.0 / (k + 1))
        rest = " * ".join(["curve.beyond", *([f"({' + '.join(_power('curve.cut', i) for i in range(k + 1))})"] if k else [])])
        side = f"above & 2 ? (above & 4 ? 1.0 : {cut}) : above & 4 ? {rest} : 0.0"
        lines.append(f"const double side_{k} = {'' if k == 0 else one + ' * '}({side});")
    for j, k in inside:
        value = f"side_{k} + curve.a * m_{j}{k} + curve.c * m_{j}{k + 1}"
        lines.append(f"const double n_{j}{k} = {value if j == 0 else f'{1.0 / (j + 1)!r} * ({value})'};")
    for j, k in sorted({(j, k) for m in stmt.moments if m.kind == "below" for j, k, _ in m.terms}):
        lines.append(f"const double rest_{j}{k} = {1.0 / ((j + 1) * (k + 1))!r} - n_{j}{k};")
    if single:
        lines += ["double sum[1];", f"sum[0] = {found[0]};"]
    else:
        lines += give(found)
    if borders:
        lines += ["if (curve.crosses) {", *indent(*(line for i in borders for line in _endless(stmt.moments[i], i, scope))), "}"]
    return [*lines, *(["return sum[0];"] if single else [])]


def _settled(stmt: Hyperbola, frame: Frame, scope: Scope) -> list[str]:
    """Returns the corners of sides that tie become 0."""
    return [
        "int settled = 0;",
        "if (teg_near_side(f0, f1, f2, f3)) {",
        *indent(
            *frame.block(0),
            f"const double scales[4] = {{{', '.join(map(scope, stmt.scale))}}};",
            "double f[4] = {f0, f1, f2, f3};",
            "settled = teg_settle(ctx, f, scales);",
            "f0 = f[0], f1 = f[1], f2 = f[2], f3 = f[3];",
        ),
        "}",
    ]


def _endless(border: Moments, i: int, scope: Scope) -> list[str]:
    """Returns a border is infinite if its curve crosses itself where its polynomial is not 0."""
    terms = [(j, k, scope(c)) for j, k, c in border.terms]

    def at(u: str | float, v: str | float) -> str:
        if isinstance(u, str) or isinstance(v, str):
            return " + ".join(" * ".join([c, *[str(u)] * j, *[str(v)] * k]) for j, k, c in terms)
        return " + ".join(f"{c} * {u**j * v**k!r}" for j, k, c in terms)

    sizes = " + ".join(f"fabs({at(u, v)})" for u, v in MIDDLES)
    return [
        "{",
        *indent(
            f"const double there = {at('curve.u', 'curve.v')}, size = {sizes};",
            f"if (fabs(there) > {literal(NO_FLUX)} * size) sum[{i}] = copysign(INFINITY, there);",
        ),
        "}",
    ]


def _polynomial(moments: Moments, scope: Scope, places: str | None) -> str:
    """Returns Σ c·moment, as an operand; the moments are variables, or those of the whole square."""
    total = ""
    for j, k, c in moments.terms:
        sign, factor = "+", f"{scope(c)} * "
        if isinstance(c, float | int) and abs(c) == 1.0:
            sign, factor = "+" if c > 0 else "-", ""
        factor += repr(1.0 / ((j + 1) * (k + 1))) if places is None else places.format(j, k)
        total += f" {sign} {factor}" if total or sign == "-" else factor
    return f"({total.strip()})"


def _power(x: str, n: int) -> str:
    return " * ".join([x] * n) if n else "1.0"


def along_function(moments: Sequence[Powers]) -> str:
    """Returns the C function that adds the moments along a branch to an array."""
    below = {(a, b) for j, k in moments for a in range(j + 1) for b in range(k + 1)}
    top = highest(frozenset(moments))
    table = series(top)
    middle = "".join(f", {v} = s->{v}" for i, v in enumerate("xy") if any(m[i] for m in moments))
    far = ["double r = 1.0 / square;", "g[0] = 0.5 * teg_turn(s->low, s->high) * sqrt(r);"]
    far += [f"g[{q + 1}] = (g[{q}] - {1.0 / (2 * q + 1)!r}) * r;" for q in range(top)]
    rows = [table.coefficients[i::CHAINS] for i in range(CHAINS)]
    near = ["const double fourth = square * square * (square * square);"]
    for i, row in enumerate(rows):
        text = repr(row[-1])
        for a in reversed(row[:-1]):
            text = f"({text}) * fourth + {a!r}" if text[0] != "(" and " " in text else f"{text} * fourth + {a!r}"
            text = f"({text})"
        near.append(f"const double part_{i} = {text};")
    near.append(f"g[{top}] = (part_0 + square * part_1) + square * square * (part_2 + square * part_3);")
    near += [f"g[{q}] = {1.0 / (2 * q + 1)!r} + square * g[{q + 1}];" for q in range(top - 1, -1, -1)]
    lines = [
        f"static inline void {function_name(moments)}(const teg_branch *s, double *sum)",
        "{",
        *indent(
            f"const double z = s->z, square = z * z{middle}; double g[{top + 1}];",
            f"if (square < {table.border!r}) {{",
            *indent(*near),
            "} else {",
            *indent(*far),
            "}",
        ),
    ]
    for j, k in sorted(below):
        terms = [f"{float(a)!r} * g[{q}]" for q, a in enumerate(moment(j, k)) if a]
        factors = ["s->rate", *(["z"] if (j + k) % 2 else []), *["s->half_x"] * j, *["s->half_y"] * k]
        lines.append(f"    const double i_{j}{k} = {' * '.join(factors)} * ({' + '.join(terms)});")
    for n, (j, k) in enumerate(moments):
        terms = []
        for a, b in product(range(j, -1, -1), range(k, -1, -1)):
            ways = comb(j, a) * comb(k, b)
            terms.append(" * ".join([*([f"{float(ways)!r}"] if ways > 1 else []), *["x"] * (j - a), *["y"] * (k - b), f"i_{a}{b}"]))
        lines.append(f"    sum[{n}] += {' + '.join(terms)};")
    return wrapped([*lines, "}"])
