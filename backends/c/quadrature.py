"""The rules in C: a piece by Gauss-Legendre, of fixed order or adaptive, roots, places and sums; the tables of Gauss-Legendre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from teg.backends.c.abreast import Nodes
from teg.backends.c.text import each, identifiers, indent, literal
from teg.numerics.quadrature import decay_power, end_rule, gauss_legendre, null_rules
from teg.program import END_INSIDE, INSIDE, Adaptive, Bend, Isolate, assigned


@dataclass(frozen=True, slots=True)
class Sums:
    """What is added up over a piece: so many values of an integrand, which the block at a place writes to `f`.

    The first `tested` of them are what the rule is chosen by, behind all of them lie the `watched` signs. `estimated` says whether errors
    are added up as well, `counted` whether evaluations are.
    """

    count: int
    tested: int
    watched: int
    estimated: bool
    counted: bool


@dataclass(frozen=True, slots=True)
class Places:
    """The places of an adaptive rule: those of the substitution `way` if they are `bent`, which may be that of a singular end if there are
    `ends`; `noted` says that the block may note ties and missed tolerances there. So many `breaks` may be neighbours."""

    bent: bool
    ends: bool
    noted: bool
    breaks: int


def gauss_piece(block: Sequence[str] | Nodes, nodes: int, count: int, estimated: int, counted: bool) -> list[str]:
    """Add a Gauss-Legendre rule over (p, q) to `sum`, and behind it the estimates of the first values; `block` writes the values at x to
    `f`."""
    place = [f"const double weight = half * teg_gauss_{nodes}[k].weight;", f"x = middle + half * teg_gauss_{nodes}[k].node;"]
    before, inside = nodes_of(block, str(nodes), place, "weight")
    return [
        "const double middle = 0.5 * (p + q), half = 0.5 * (q - p);",
        *(["const double rounding = teg_rounding(p, q);"] if estimated else []),
        *([f"ctx->evaluations += {nodes};"] if counted else []),
        *before,
        f"for (int k = 0; k < {nodes}; k++) {{",
        *indent(
            *inside,
            each(count, "sum[j] += weight * f[j];") if not estimated else _each(count, "sum[j] += weight * f[j];"),
            *([_each(estimated, f"sum[{count} + j] += rounding * weight * fabs(f[j]);")] if estimated else []),
        ),
        "}",
    ]


def nodes_of(block: Sequence[str] | Nodes, nodes: str, place: Sequence[str], factor: str) -> tuple[list[str], list[str]]:
    """Returns lines before the loop over nodes, and those in it that write the values at node k to `f`; `place` sets x and the factor."""
    if isinstance(block, Nodes):
        return block.before(nodes, place, factor), block.at_node(factor)
    return [], [*place, *block]


def midpoint_piece(block: Sequence[str], points: int, count: int, tested: int, counted: bool) -> list[str]:
    """Add the midpoint rule over (p, q) to `sum`, and the error estimates of the first values, if any, behind them."""
    n = f"{float(points)!r}"
    variation = [
        f"for (int j = 0; j < {tested}; j++) {{",
        *indent(
            "const double step = k > 0 ? fabs(f[j] - last[j]) : 0.0;",
            f"sum[{count} + j] += 0.5 * weight * (step + TEG_ROUNDING * fabs(f[j]));",
            "last[j] = f[j];",
        ),
        "}",
    ]
    return [
        f"const double weight = (q - p) / {n};",
        *([f"ctx->evaluations += {points};"] if counted else []),
        f"for (int k = 0; k < {points}; k++) {{",
        *indent(
            f"x = p + (q - p) * ((k + 0.5) / {n});",
            *block,
            each(count, "sum[j] += weight * f[j];"),
            *(variation if tested else []),
        ),
        "}",
    ]


def _cleared(count: int, tested: int) -> list[str]:
    return [f"teg_fill(measured, {8 * tested}, 0.0);", *([f"teg_fill(plain, {count - tested}, 0.0);"] if count > tested else [])]


def _added(count: int, tested: int) -> list[str]:
    """Adds the values in `f`, times dv/du, to the measurements."""
    plain = _each(count - tested, f"plain[j] += rule[0] * (slope * f[{tested} + j]);")
    return [
        f"for (int j = 0; j < {tested}; j++) {{",
        *indent(
            "const double y = slope * f[j], factor[8] = {y, y, y, y, y, y, y, fabs(y)};",
            "for (int r = 0; r < 8; r++) measured[8 * j + r] += rule[r] * factor[r];",
        ),
        "}",
        *([plain] if count > tested else []),
    ]


def _taken(count: int, tested: int, estimated: bool) -> list[str]:
    """Add what was measured to `sum`."""
    lines = [_each(tested, "sum[j] += measured[8 * j];")]
    if count > tested:
        lines.append(_each(count - tested, f"sum[{tested} + j] += plain[j];"))
    if estimated:
        lines.append(_each(tested, f"sum[{count} + j] += measured[8 * j + 1] + rounding * measured[8 * j + 7];"))
    return lines


def _each(count: int, statement: str) -> str:
    return f"for (int j = 0; j < {count}; j++) {statement}"


def middle_of_piece(infinite: bool, scale: str) -> str:
    """Returns the place on the piece (p, q) at which its conditions are decided."""
    return f"double x = teg_inside(p, q, {scale});" if infinite else f"double x = p + {INSIDE!r} * (q - p);"


def bent_piece(bends: Sequence[tuple[Bend, str, Sequence[str]]], base: str, cubic: bool, tail: Sequence[str]) -> list[str]:
    """Returns the substitution of a piece: each bend with how its `when` and its coefficients are spelled; the scale of its tails and their
    reach, if they have one, or nothing."""
    lines = ["teg_substitution way;", f"teg_straight(&way, p, q, {int(cubic)});"]
    for bend, when, coefficients in bends:
        lines.append(f"teg_bend(&way, '{bend.kind[0]}', {when}, {', '.join([base, *coefficients])});")
    routine = "teg_slow_tail" if len(tail) > 1 else "teg_tail"
    return [*lines, *(["teg_bent(&way);"] if bends else []), *([f"{routine}(&way, {', '.join(tail)});"] if tail else [])]


def adaptive_piece(block: Sequence[str] | Nodes, rule: Adaptive, sums: Sums, places: Places, guard: GuardText | None = None) -> list[str]:
    """Add the adaptive rule over (p, q) to `sum`, from the left; `waiting` is a stack of intervals.

    `block` writes the values at x to `f`, then the watched signs. If there are any, or the rule is closed, k runs over the ends of the
    interval (-2, -1) before the nodes, where nothing is noted, and stops where a sign changed and the interval will be halved anyway.
    """
    count, tested, watched = sums.count, sums.tested, sums.watched
    aside = watched > 0 or rule.closed
    place = _place_in_interval(rule, places.bent, aside)
    whole = "whole" if guard is None else "above + here.depth * " + str(tested)
    table, good = _assessed(rule, sums, whole, places)
    before, after = _at_the_ends(rule, sums, places.noted)
    end = f"(2 * k + 3) * {1.0 - 2.0 * END_INSIDE!r}" if rule.closed else "2 * k + 3"
    node = f"(k < 0 ? {end} : table[k].node)" if aside else "table[k].node"
    unknown = ["const int tied = ctx->tied, missed = ctx->missed;"] if aside and places.noted else []
    first, inside = nodes_of(block, "nodes", [f"const double u = middle + half * {node};", *place, *unknown], "slope")
    return [
        *([f"const int neighbours = teg_neighbours(ends, {places.breaks}, pieces, p, q);"] if places.breaks else []),
        "teg_interval waiting[TEG_MAX_DEPTH + 2];",
        "waiting[0] = (teg_interval){0.0, 1.0, 0};",
        *(f"teg_fill({total}, {tested}, 0.0);" for total in ("spent", "whole", "total")),
        "for (int n = 1, used = 1; n > 0; used++) {",
        *indent(
            "const teg_interval here = waiting[--n];",
            "const double middle = 0.5 * (here.from + here.to), half = 0.5 * (here.to - here.from);",
            "const int deep = here.depth >= TEG_MAX_DEPTH || used >= TEG_MAX_INTERVALS;",
            "const int last = deep || ctx->work > TEG_MAX_EVALUATIONS;",
            *table,
            "ctx->work += nodes;",
            *([f"ctx->evaluations += nodes + {2 * aside};"] if sums.counted else []),
            *_cleared(count, tested),
            *before,
            *first,
            f"for (int k = {-2 if aside else 0}; k < nodes; k++) {{",
            *indent(
                *inside,
                *after,
                *([] if guard is None else [_each(guard.sharp, f"seen_at[{guard.sharp} * k + j] = f[{count + watched} + j];")]),
                "const double *const rule = table[k].rule;",
                *_added(count, tested),
                *([_each(2 * tested, f"apart[j] -= teg_ends_{rule.order}[k][j % 2] * (slope * f[j / 2]);")] if rule.closed else []),
            ),
            "}",
            *([f"teg_at_ends({tested}, measured, apart, teg_ends_{rule.order}[nodes][0]);"] if rule.closed else []),
            *_judged(tested, watched, good, None if guard is None else _searched(guard, place, tested, whole, _tolerance(rule))),
            *_halved_or_accepted(rule, sums, "whole[j]" if guard is None else f"({whole})[j]", guard is not None),
            *(_rounding_within(place) if sums.estimated else []),
            *_taken(count, tested, sums.estimated),
        ),
        "}",
        f"if (teg_overspent({tested}, spent, whole, total, {_tolerance(rule)})) ctx->missed = 1;",
    ]


def _tolerance(rule: Adaptive) -> str:
    """Returns the tolerance and the floor of the integral as arguments."""
    return f"{literal(rule.tol)}, {literal(rule.floor)}"


def _rounding_within(place: Sequence[str]) -> list[str]:
    """Returns lines that set `rounding`, the effect of rounding on the interval."""
    return [
        "double put[3] = {p, q, p};",
        "for (int side = 0; side < 3; side++) {",
        *indent(
            "const double u = side == 0 ? here.from : side == 1 ? here.to : middle;",
            "if (u <= 0.0 || u >= 1.0) continue;",
            *place,
            "(void)slope;",
            "put[side] = x;",
        ),
        "}",
        "const double nearby = 0.5 * TEG_ROUNDING + teg_placed(put[0], put[2], put[1]);",
        "const double rounding = fmax(teg_rounding(p, q), nearby);",
    ]


def _place_in_interval(rule: Adaptive, bent: bool, aside: bool) -> list[str]:
    """Returns lines that set x at the place u of (0, 1), and `slope`, by which the weights of the nodes are multiplied."""
    if bent:
        return ["double slope;", "x = teg_place(&way, u, &slope);", "slope *= half;"]
    place = ["const double slope = half * (q - p);", "x = p + (q - p) * u;"]
    if rule.cubic:
        place = ["const double slope = half * (q - p) * (6.0 * u * (1.0 - u));", "x = p + (q - p) * (u * u * (3.0 - 2.0 * u));"]
    return [*place, "x = teg_within(p, q, x);"] if aside else place


def _assessed(rule: Adaptive, sums: Sums, whole: str, places: Places) -> tuple[list[str], str]:
    """Returns lines that choose the table of nodes, and the condition under which the measurements are good enough.

    The first look has a rule of its own, unless there is none.
    """
    first, power = (decay_power(n, rule.closed) for n in (rule.first, rule.order))
    single = sums.watched > 0 or rule.closed
    powers = str(power) if single or first == power else f"(used == 1 ? {first} : {power})"
    rough = ["way.kind == TEG_POWER"] if places.ends else []
    if places.breaks:
        rough += ["((neighbours & 1) && here.from == 0.0)", "((neighbours & 2) && here.to == 1.0)"]
    choice = [f"const int power = {' || '.join(rough)} ? 0 : {powers};"] if rough else []
    apart = "apart" if rule.closed else "NULL"
    good = f"teg_assess({sums.tested}, measured, {apart}, {whole}, {_tolerance(rule)}, {'power' if rough else powers})"
    if single:
        table = [f"const int nodes = {rule.order};", f"const teg_node *const table = teg_nodes_{rule.order};"]
        if not sums.watched:
            return [*table, *choice], good
        # it writes the errors of any interval that is taken
        return [*table, *choice], f"({good} && !changed) || (changed && fine)"
    table = [
        f"const int nodes = used == 1 ? {rule.first} : {rule.order};",
        f"const teg_node *const table = used == 1 ? teg_nodes_{rule.first} : teg_nodes_{rule.order};",
    ]
    return [*table, *choice], good


def _at_the_ends(rule: Adaptive, sums: Sums, noted: bool) -> tuple[list[str], list[str]]:
    """Returns lines before the nodes of an interval and behind the values at a node: they note whether a watched sign has `changed`, or is
    `hidden` by rounding, and the values at the ends for a closed rule."""
    count, watched = sums.count, sums.watched
    forgotten = ["if (k < 0) ctx->tied = tied, ctx->missed = missed;"] if noted else []
    kept = [f"if (k < 0) {_each(sums.tested, 'apart[2 * j + k + 2] = slope * f[j];')}"] if rule.closed else []
    if not watched:
        return [], [*forgotten, *kept, "if (k < 0) continue;"] if rule.closed else []
    before = ["const int fine = here.to - here.from <= TEG_WATCH_WIDTH;", f"int changed = 0, hidden = 0, seen[{watched}] = {{0}};"]
    return before, [
        f"for (int j = 0; j < {watched}; j++) changed |= (seen[j] |= (f[{count} + j] > 0.0) + 2 * (f[{count} + j] < 0.0)) == 3;",
        *forgotten,
        "if (changed && !fine && !last && used > 1) break;",
        _each(watched, f"hidden |= f[{count} + j] == 0.0;"),
        *kept,
        "if (k < 0) continue;",
    ]


def _judged(tested: int, watched: int, good: str, searched: Sequence[str] | None) -> list[str]:
    """Returns lines that set `good`; `searched` are those that look between the nodes, of an integral with a guard."""
    if searched is None:
        return [f"if (used == 1) {_each(tested, 'whole[j] = measured[8 * j + 7];')}", f"const int good = {good};"]
    return [
        f"teg_largest({tested}, measured, whole, above, here.depth, used);",
        f"int good = {good}, hides = 0;",
        f"double hidden_size[{tested}] = {{0.0}};",
        f"if (good && {'!changed && ' if watched else ''}teg_settled({tested}, measured)) {{",
        *indent(*searched),
        "}",
    ]


def _halved_or_accepted(rule: Adaptive, sums: Sums, whole: str, guarded: bool) -> list[str]:
    """Returns lines that put both halves of an interval that is not good on the stack, or note what is missed if it is the last one.

    The first look at a piece, which has fewer nodes, is followed by another one at all of it, unless there is none.
    """
    tested, watched = sums.tested, sums.watched
    again = [] if watched or rule.closed else ["if (used == 1) {", *indent("waiting[n++] = here;", "continue;"), "}"]
    unchanged = "!changed && !hidden && " if watched else ""
    hidden = "if (!(hidden_size[j] <= measured[8 * j + 1])) measured[8 * j + 1] = isnan(hidden_size[j]) ? INFINITY : hidden_size[j];"
    diverges = f"{unchanged}isfinite(measured[8 * j + 1]) && measured[8 * j + 7] > TEG_DIVERGENT * {whole}"
    return [
        "if (!good && !last) {",
        *indent(
            *again,
            "waiting[n++] = (teg_interval){middle, here.to, here.depth + 1};",
            "waiting[n++] = (teg_interval){here.from, middle, here.depth + 1};",
            "continue;",
        ),
        "}",
        "if (!good) {",
        *indent(
            "ctx->missed = 1;",
            "if (here.depth >= TEG_DEEP) {",
            *indent(_each(tested, f"if ({diverges}) measured[8 * j] = copysign(INFINITY, measured[8 * j]);")),
            "}",
            *([f"if (hides) {_each(tested, hidden)}"] if guarded else []),
        ),
        "}",
        ("if (!changed) " if watched else "") + _each(tested, "spent[j] += measured[8 * j + 1];"),
        _each(tested, "total[j] += measured[8 * j];"),
        _each(tested, "if (isinf(measured[8 * j])) ctx->missed = 1;"),
    ]


@dataclass(frozen=True, slots=True)
class GuardText:
    """The lines that write, from `left` and `right`, bounds of the tested values' sizes and of so many sharp values to `f`."""

    block: Sequence[str]
    sharp: int


def _searched(guard: GuardText, place: Sequence[str], tested: int, above: str, tol: str) -> list[str]:
    """Make `good` 0 if something is hidden between the nodes: first the whole interval, number -1, then the gaps."""

    def end(name: str, u: str, at_end: str) -> list[str]:
        return [f"if ({at_end}) {{", *indent(f"const double u = {u};", *place, "(void)slope;", f"{name} = x;"), "}"]

    return [
        "for (int gap = -1; gap <= nodes && good; gap++) {",
        *indent(
            "const double first = gap < 1 ? here.from : middle + half * table[gap - 1].node;",
            "const double second = gap < 0 || gap == nodes ? here.to : middle + half * table[gap].node;",
            "double left = p, right = q;",
            *end("left", "first", "first > 0.0"),
            *end("right", "second", "second < 1.0"),
            *guard.block,
            "const int endless = !isfinite(right - left);",
            "const int within = first > 0.0 && second < 1.0, outermost = !within && here.depth >= TEG_DEEP;",
            "const int inside = endless || (within && here.depth < TEG_GUARD_DEPTH);",
            f"const double most = teg_tolerated({tested}, measured, {above}, {tol}) / (right - left);",
            f"const int unseen = teg_matters({tested}, f, right - left, measured, {above}, {tol})",
            f"    && teg_unseen({guard.sharp}, f + {tested}, most, seen_at, nodes, gap, inside, endless || outermost);",
            f"if (gap < 0) {_each(tested, 'hidden_size[j] = !endless && isinf(f[j]) ? 0.0 : f[j] * (right - left);')}",
            "if (gap < 0 && !unseen) break;",
            "if (gap >= 0 && unseen) good = 0, hides = 1;",
        ),
        "}",
    ]


def isolation(enclosure: Sequence[str], point: Sequence[str], search: tuple[str, str, str], stmt: Isolate) -> list[str]:
    """Write the roots of a `search`, which has two bounds and a tolerance, to `root`, and behind them their errors, if the statement has
    them: `point` writes g, g' and g" at x to `f`, `enclosure` what is known over (left, right) to `f + 3`.

    A box that its bounds alone clear spares the run of `point`.
    """
    count, single = len(stmt.results), len(assigned(stmt)) == 1
    errors = f"root + {count}" if stmt.errors else "NULL"
    lo, hi, tol = search
    given = f"{lo}, {hi}, root, {errors}, {count}, {stmt.width}, {tol}"
    return [
        *(["double root[1];"] if single else []),
        "teg_isolation search;",
        f"teg_isolate(&search, {given});",
        "while (search.asks != TEG_DONE) {",
        *indent(
            "if (search.asks == TEG_BOX || search.asks == TEG_TOUCH) {",
            *indent(
                *_used(enclosure, left="search.from", right="search.to"),
                *enclosure,
                "if (search.asks == TEG_BOX && teg_is_clear(&search.box, f + 3)) {",
                *indent("teg_next_box(&search);", "continue;"),
                "}",
            ),
            "}",
            *_used(point, x="search.at"),
            *point,
            "teg_answer(&search, f);",
        ),
        "}",
        "teg_roots(&search, ctx);",
        *(["return root[0];"] if single else []),
    ]


def location(enclosure: Sequence[str], v: tuple[str, str], u: tuple[str, str], count: int, slopes: bool, counted: bool) -> list[str]:
    """Write the places between the ends of v to `place`, and behind them, if it is `counted`, the part that was given up: `enclosure`
    writes bounds of f and g over a rectangle to `f`, and if there are `slopes` those of their slopes."""
    sides = {side: f"search.here.{side}" for side in ("left", "right", "bottom", "top")}
    single = count == 1 and not counted
    return [
        *(["double place[1];"] if single else []),
        "teg_location search;",
        f"teg_locate(&search, {int(slopes)}, {', '.join((*v, *u))});",
        "while (teg_next_rectangle(&search)) {",
        *indent(*_used(enclosure, **sides), *enclosure, "teg_judge(&search, f);"),
        "}",
        f"const double lost = teg_places(&search, place, {count});",
        "if (lost > TEG_LOCATE_LOST) ctx->missed = 1;",
        *([f"place[{count}] = lost;"] if counted else []),
        *(["return place[0];"] if single else []),
    ]


def _used(lines: Sequence[str], **variables: str) -> list[str]:
    """Returns declarations of the variables that are in these lines."""
    used = identifiers("\n".join(lines))
    return [f"const double {name} = {value};" for name, value in variables.items() if name in used]


def sum_over(block: Sequence[str], points: int, count: int) -> list[str]:
    """Add the values at each finite one of `points` to `sum`; `block` writes the values at x to `f`."""
    nan = "return NAN;" if count == 1 else f"{{ teg_fill(sum, {count}, NAN); return; }}"
    return [
        f"for (int i = 0; i < {points}; i++) if (isnan(points[i])) {nan}",
        "double sum[1] = {0.0};" if count == 1 else f"teg_fill(sum, {count}, 0.0);",
        f"for (int i = 0; i < {points}; i++) {{",
        *indent(
            "const double x = points[i];",
            "if (!isfinite(x)) continue;",
            *block,
            each(count, "sum[j] += f[j];"),
        ),
        "}",
        *(["return sum[0];"] if count == 1 else []),
    ]


def gauss_table(nodes: int) -> str:
    """Returns nodes and weights of n-point Gauss-Legendre, as an array of C."""
    rows = [f"    {{{node!r}, {weight!r}}}," for node, weight in zip(*gauss_legendre(nodes), strict=True)]
    kind = "static const struct {\n    double node, weight;\n}"
    return "\n".join([f"{kind} teg_gauss_{nodes}[{nodes}] = {{", *rows, "};"])


def node_table(nodes: int) -> str:
    """Nodes, weights and null rules of n-point Gauss-Legendre, as an array of C."""
    at, weights = gauss_legendre(nodes)
    rows = []
    for x, *rule in zip(at, weights, *null_rules(nodes), strict=True):
        first, second = (", ".join(map(repr, part)) for part in (rule[:4], (*rule[4:], rule[0])))
        rows += [f"    {{{x!r},", f"     {{{first},", f"      {second}}}}},"]
    return "\n".join([f"static const teg_node teg_nodes_{nodes}[{nodes}] = {{", *rows, "};"])


def end_table(nodes: int) -> str:
    """Returns the weights of n nodes in what a polynomial through them is at both ends; behind them, twice, the distance of the outermost
    node from an end."""
    gap, rows = end_rule(nodes, END_INSIDE)
    lines = [f"    {{{left!r}, {right!r}}}," for left, right in (*zip(*rows, strict=True), (gap, gap))]
    return "\n".join([f"static const double teg_ends_{nodes}[{nodes + 1}][2] = {{", *lines, "};"])
