"""`teg.substitute` and `teg.let`: expressions in the place of variables and parameters.

Equal subexpressions are one node, so a name for a subexpression is not a part of the language: `let` is substitution, and what it shares is
computed once, as it is without a name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar, cast

from teg.errors import OperandError, ParameterError, ScopeError
from teg.ir.arrays import Ranged, integer_parameters, integers_of, open_indices
from teg.ir.cells import replace_integers, replaced
from teg.ir.expr import Cond, Expr, Operand, Param, Still, Tuple, Var
from teg.ir.index import Index, IndexParam, IndexVar, as_index, index_leaves
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number
from teg.ir.still import with_still_parameters
from teg.ir.traverse import fresh, parameters, rebuild
from teg.ir.traverse import substitute as substitute_variables

N = TypeVar("N", bound="Expr | Cond")


def substitute(e: N, replacements: Mapping[Var | Param, Operand]) -> N:
    """Returns an expression, a tuple or a condition with variables and parameters replaced by expressions, all at once.

    Variables that an integral in e binds are other variables of the same name, and stay; so do the indices of sums. An integral or sum
    that would bind a variable or an index of a replacement is renamed: nothing is captured. A parameter that is used as an integer is
    replaced by an integer. Parameters that vanish, as in 0·t, are no arguments of the result.

    Raises ParameterError for keys that are neither variables nor parameters, OperandError for replacements that are no numbers,
    ArrayIndexError for one that is not an integer where an integer is used.

        x, t = teg.var("x"), teg.param("t")
        str(teg.substitute(x**2 + t, {x: t + 1}))                        # (t + 1)² + t
        str(teg.substitute(teg.integral(x * t, (x, 0, 1)), {t: x}))      # ∫[x′: 0..1] x′·x
    """
    root: Node = e if isinstance(e, Tuple | Cond) else as_number(e)
    if not isinstance(replacements, Mapping):
        raise ParameterError("replacements are a dict, variable or parameter -> expression", None, "teg.substitute(e, {x: t + 1})")
    values: dict[Var | Param, Expr] = {}
    for key, value in replacements.items():
        if not isinstance(key, Var | Param):
            raise ParameterError(f"{key!s:.80} is neither a variable nor a parameter", None, "teg.substitute(e, {x: t + 1})")
        values[key] = as_number(value)
    root = _with_sums_apart(root, {k for value in values.values() for k in open_indices(value)[value]})
    root = _with_integers(root, replacements)
    places: dict[Node, Expr] = {}
    mapping: dict[Var, Expr] = {v: value for v, value in values.items() if isinstance(v, Var)}
    taken = {n for tree in (root, *values.values()) for n in postorder([tree]) if isinstance(n, Var)}
    for p in (p for p in values if isinstance(p, Param)):
        for node, value in ((p, values[p]), (Still.make(p.name, ()), with_still_parameters(values[p]))):
            places[node] = v = fresh(f"{p.name}′", taken | mapping.keys())
            mapping[v] = value
    (renamed,) = replaced([cast(Expr, root)], places) if places else (root,)
    return cast(N, substitute_variables(renamed, mapping))


def _with_sums_apart(root: Node, indices: set[IndexVar]) -> Node:
    """Returns the expression with other indices in the sums over these."""
    if not indices:
        return root
    taken = {i.name for node in postorder([root]) for n in integers_of(node) for i in index_leaves([n]) if isinstance(i, IndexVar)}
    taken |= {k.name for k in indices}
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        children = tuple(new[c] for c in node.children)
        if isinstance(node, Ranged) and node.index in indices:
            name = node.index.name
            while name in taken:
                name += "′"
            k = IndexVar.make(name, ())
            new[node] = node.over(tuple(replace_integers(cast(Expr, c), {node.index: k}) for c in children), k, node.lo, node.hi)
        else:
            new[node] = rebuild(node, children)
    return new[root]


def _with_integers(root: Node, replacements: Mapping[Var | Param, Operand]) -> Node:
    """Returns the expression with the parameters replaced that are used as integers there."""
    used = [p for p in integer_parameters(root) if p in replacements]
    numbers: dict[Index, Index] = {}
    for p in used:
        value = replacements[p]
        numbers[IndexParam.make(p, ())] = as_index(int(value) if isinstance(value, float) and value.is_integer() else value, root)
    return replace_integers(cast(Expr, root), numbers) if numbers else root


def let(definitions: Mapping[Var | Param | str, Operand], body: N) -> N:
    """Returns `body` with names replaced by their definitions; a definition may use the names defined before it.

    A name is a variable, a parameter, or a text, which means the variable of this name. What a name stands for is computed once, however
    often it is used. In contrast to `teg.substitute`, which replaces everything at once, definitions are read in order. A variable in a
    definition is never that of an integral inside of `body`: a name for a part of an integrand is defined inside of its integral.

    Raises ScopeError for a definition that uses its own name or a later one, and for a text that is the name of a parameter there, not of a
    variable; and the errors of `teg.substitute`.

        x, r, s = teg.vars("x r s")
        t = teg.param("t")
        str(teg.let({r: x - t, s: r**2}, teg.exp(-s) * r))               # exp(-(x - t)²)·(x - t)
    """
    if not isinstance(definitions, Mapping):
        raise ParameterError("definitions are a dict, name -> expression", None, "teg.let({u: x * x}, u + 1)")
    named: list[tuple[Var | Param, Operand]] = [(Var.make(k, ()) if isinstance(k, str) else k, v) for k, v in definitions.items()]
    for i, (key, value) in enumerate(named):
        whole = as_number(value)
        later = {k for k, _ in named[i:]}
        if used := [n for n in (*whole.free, *parameters(whole)) if n in later]:
            name = used[0].name
            what = "itself" if used[0] is key else f"{name}, which is defined later"
            raise ScopeError(f"the definition of {key.name} uses {what}", whole, "a definition may use the names before it")
    if len({k for k, _ in named}) < len(named):
        raise OperandError("a name is defined twice", None, "a variable and the text of its name are one name")
    trees = [body if isinstance(body, Tuple | Cond) else as_number(body), *(as_number(value) for value in definitions.values())]
    texts = {k for k in definitions if isinstance(k, str)} - {v.name for tree in trees for v in tree.free}
    for p in (p for tree in trees for p in parameters(tree) if p.name in texts):
        way = f"teg.let({{{p.name}: …}}, body), with the parameter itself as the name"
        raise ScopeError(f'the text "{p.name}" names a variable, and {p.name} is a parameter here', trees[0], way)
    for key, value in reversed(named):
        body = substitute(body, {key: value})
    return body
