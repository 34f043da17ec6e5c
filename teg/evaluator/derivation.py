"""What the passes make of one program: outputs and flat programs, made when they are asked for, shared where only bodies differ.

A program with functions is derived with slots in their places (`teg.function`), so programs that differ in the bodies of their functions
only are one here, and so is all that the passes do. What they did lives as long as an evaluator that uses it: the table below holds weak
references only, as that of the nodes does.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field

from teg.analysis.settings import Integration
from teg.ir.expr import Expr, Param
from teg.ir.function import Function
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.normalise.inline import with_slots, without_slots, write_out
from teg.passes.program.link import with_bodies
from teg.pipeline import compiled_outputs, flatten, program_for
from teg.program import Program


@dataclass(frozen=True)
class Task:
    """What is to be derived: of which expression, by which parameters, as a program of which arguments, how."""

    expression: Expr
    wrt: tuple[Param, ...]
    arguments: tuple[str, ...]
    integration: Integration
    discontinuities: str
    maps: tuple[Diffeomorphism, ...]


class Derivation:
    """Outputs and programs of one task, by order of derivative."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._outputs: dict[int, list[Expr]] = {}
        self._programs: dict[tuple[int, bool, Integration], Program] = {}
        self._lock = threading.RLock()

    def outputs(self, orders: int) -> list[Expr]:
        """The δ-free expressions of value, gradient, Hessian (as many as asked for)."""
        task = self.task
        with self._lock:
            if orders not in self._outputs:
                self._outputs[orders] = compiled_outputs(
                    task.expression, task.wrt, orders, task.discontinuities, task.maps, task.integration.closed_forms
                )
            return self._outputs[orders]

    def program(self, orders: int, errors: bool = False, how: Integration | None = None) -> Program:
        """The scheduled program of value (0), value and gradient (1), value, gradient and Hessian (2); with `errors` estimates behind;
        integrated as the task says, or as `how` does."""
        task = self.task
        key = orders, errors, how or task.integration
        with self._lock:
            if key not in self._programs:
                flat = [leaf for e in self.outputs(orders) for leaf in flatten(e)]
                self._programs[key] = program_for(flat, task.arguments, key[2], errors)
            return self._programs[key]


@dataclass(frozen=True)
class Linked:
    """A derivation, and the functions that stand in its slots."""

    derivation: Derivation
    functions: tuple[Function, ...]
    _programs: dict[tuple[int, bool, Integration | None], Program] = field(default_factory=dict)

    def outputs(self, orders: int) -> list[Expr]:
        """Those of the derivation, with the functions."""
        found = self.derivation.outputs(orders)
        return [without_slots(e, self.functions) for e in found] if self.functions else found

    def program(self, orders: int, errors: bool = False, how: Integration | None = None) -> Program:
        """That of the derivation, with the bodies of the functions."""
        key = orders, errors, how
        if key not in self._programs:
            self._programs[key] = with_bodies(self.derivation.program(orders, errors, how), self.functions)
        return self._programs[key]


def linked(
    e: Expr,
    wrt: Sequence[Param],
    arguments: Sequence[str],
    integration: Integration,
    discontinuities: str,
    maps: Sequence[Diffeomorphism],
) -> Linked:
    """What is derived of an expression; of one with functions it is shared with those that have others."""
    abstract, functions = with_slots(write_out(e))
    task = Task(abstract, tuple(wrt), tuple(arguments), integration, discontinuities, tuple(maps))
    if not functions:
        return Linked(Derivation(task), ())
    with _lock:
        found = _derivations.get(task)
        if found is None:
            found = _derivations[task] = Derivation(task)
    return Linked(found, functions)


_derivations: weakref.WeakValueDictionary[Task, Derivation] = weakref.WeakValueDictionary()
_lock = threading.Lock()
