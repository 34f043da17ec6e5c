"""The values of parameters in pytrees of JAX: nested dicts, tuples, lists, dataclasses and modules, read by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from teg.errors import ParameterError
from teg.evaluator.arguments import name_of


def is_leaf(value: Any) -> bool:
    """Returns whether a value is no structure of JAX's: a number, an array, or an object that JAX does not know."""
    return not isinstance(value, Mapping) and _children(value) is None


def values_in_pytree(tree: Any, names: Collection[str]) -> dict[str, Any]:
    """Returns the values in a pytree by the names of parameters.

    A parameter is found by its path, the keys, fields and positions that lead to it joined by underscores ("camera_t", "edges_0_t"), or by
    the last of them ("t"). Values of None are left out. Raises ParameterError for a name that is found twice.
    """
    found: dict[str, Any] = {}
    places: dict[str, str] = {}
    stack = [("", "", tree)]
    while stack:
        path, key, node = stack.pop()
        name = path if path in names else key
        children = None if name in names else _children(node)
        if children is not None:
            stack += [(f"{path}_{k}" if path else k, k, v) for k, v in reversed(children)]
            continue
        name = name if name in names else path
        if name in found:
            hint = f"parameters may have the names of their places: teg.param({path!r})"
            raise ParameterError(f"the parameter {name!r} is given twice: {places[name]}, {path}", None, hint)
        found[name], places[name] = node, path
    return found


def _children(node: Any) -> list[tuple[str, Any]] | None:
    """Returns the entries of a structure with their keys; None for an object that is no structure."""
    if isinstance(node, Mapping):
        return [(str(name_of(k)), v) for k, v in node.items()]
    if isinstance(node, int | float):
        return None
    from jax import tree_util

    pairs, _ = tree_util.tree_flatten_with_path(node, is_leaf=lambda other: other is not node)
    if len(pairs) == 1 and not pairs[0][0]:
        return None
    return [(tree_util.keystr(path, simple=True, separator="_"), value) for path, value in pairs]
