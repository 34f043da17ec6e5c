"""Integrals with their breaks and rules, and the cost of programs, as data of an explanation."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import Any

from teg.analysis.isolation import MAX_ROOTS, max_roots
from teg.analysis.roots import solve
from teg.analysis.settings import Integration
from teg.analysis.surfaces import binders_inside
from teg.ir.expr import Expr
from teg.ir.integral import Integral, masses_of
from teg.numerics.sobol import replicated
from teg.passes.intrinsics import STATEMENTS, intrinsics_for
from teg.passes.lower.features import Features
from teg.passes.lower.intrinsic import Description
from teg.passes.lower.rules import Rules
from teg.passes.lower.samples import MIDPOINTS, SAMPLES
from teg.program import Adaptive, Arg, Integrate, Isolate, Locate, Program, Rule, Sample, Stmt, SumOver, When, statements
from teg.report.inventory import nests, text_of


class Integrals:
    """Breaks and rules of integrals, as lowering chooses them."""

    def __init__(self, how: Integration, differentiated: Sequence[Expr] = ()) -> None:
        self.how = how
        self.intrinsics = intrinsics_for(how)
        self.rules = Rules(how, [i.rule for i in self.intrinsics if i.rule is not None], differentiated)
        self.analysis = self.rules.analysis
        self.features = Features(self.rules, lambda nodes: frozenset().union(*map(binders_inside, nodes)))
        self._described: dict[Integral, Description | None] = {}

    def of(self, roots: Sequence[Expr], but: Sequence[Expr] = ()) -> list[dict[str, Any]]:
        """Returns the integrals of expressions, outer ones first, without those of `but`; integrals that look the same are counted
        together."""
        known = {node for root in but for node in nests(root)}
        rows: dict[tuple[object, ...], dict[str, Any]] = {}
        for root in roots:
            depths: dict[Integral, int] = {}
            for node, around in nests(root).items():
                if not isinstance(node, Integral) or any(node in d.inside for d in map(self._describe, around[:-1]) if d):
                    continue
                depths[node] = next((depths[i] + 1 for i in reversed(around[:-1]) if i.var in node.free), 0)
                if node not in known:
                    row = self._row(node, depths[node])
                    same = rows.setdefault(tuple(row.values()), {**row, "count": 0})
                    same["count"] += 1
        return list(rows.values())

    def _describe(self, node: Integral) -> Description | None:
        """Returns the description by an intrinsic that computes an integral; None if none does."""
        if node not in self._described:
            found = (intrinsic.describe(node) for intrinsic in self.intrinsics)
            self._described[node] = next((d for d in found if d is not None), None)
        return self._described[node]

    def _row(self, node: Integral, depth: int) -> dict[str, Any]:
        row = {"variable": node.var.name, "lower": text_of(node.lo), "upper": text_of(node.hi), "depth": depth}
        masses = masses_of(node.body, node.var)
        if masses is None and self.how.rule in SAMPLES_OF:
            text = f"{SAMPLES_OF[self.how.rule]}, {self.how.order or SAMPLES} in all"
            return {**row, **_unbroken(text), "nodes": None}
        if masses is None and self.how.rule == "midpoint":
            return {**row, **_unbroken("midpoint"), "nodes": self.how.order or MIDPOINTS}
        if masses is not None:
            roots = solve(masses.g, node.var, node.lo, node.hi)
            formula = len(roots.found) if roots is not None and roots.certain else 0
            isolated = 0 if formula else max_roots(masses.g, node.var, self.how.max_roots)
            kind = {"kind": "sum over roots", "surface": f"{text_of(masses.g)} = 0", "rule": "sum", "nodes": None, "degree": None}
            return {**row, **kind, "formula": formula, "isolated": isolated, "located": 0, "searched": False, "breaks": 0, "pieces": 0}
        described = self._describe(node)
        if described is not None:
            counts = {"nodes": described.nodes, "degree": described.degree, "pieces": described.pieces}
            return {**row, **_unbroken(described.rule), **counts}
        rule, breaks = self.rules.of(node, depth), self.analysis.of(node)
        isolated, located = sum(i.count for i in breaks.isolated), MAX_ROOTS * len(breaks.located)
        formula = len(breaks.points) + self.features.count(node, depth)
        return {
            **row,
            "kind": "integral",
            "surface": "",
            "rule": self.rules.title(rule),
            "nodes": _nodes_a_piece(rule),
            "degree": self.analysis.degree(node),
            "formula": formula,
            "isolated": isolated,
            "located": located,
            "searched": not breaks.complete,
            "breaks": formula + isolated + located,
            "pieces": formula + isolated + located + 1,
        }


SAMPLES_OF = {"montecarlo": "Monte Carlo samples", "qmc": "scrambled Sobol' points"}
"""The names of the samples that sampling rules take."""


def _unbroken(rule: str) -> dict[str, Any]:
    """Returns an integral without breaks."""
    counts = dict.fromkeys(("formula", "isolated", "located", "breaks"), 0)
    return {"kind": "integral", "surface": "", "rule": rule, "degree": None, **counts, "searched": False, "pieces": 1}


def _nodes_a_piece(rule: Rule) -> int:
    """Returns the number of nodes of a piece, if it is not cut further."""
    return rule.first if isinstance(rule, Adaptive) else rule.nodes


# -- cost ----------------------------------------------------------------------------------------------------------------


def cost_of(program: Program) -> dict[str, Any]:
    """Returns the size of a program, and the number of evaluations of integrands in one run: pieces × nodes, times those of the outer
    integral; also the least that its rules can do with, where each integral has one piece, each polygon one triangle, and each
    polyhedron one tetrahedron."""
    every = list(statements(program.body))
    integrals = [s for s in every if isinstance(s, Integrate)]
    hints = {r for s in every if isinstance(s, Locate) for r in s.results}
    return {
        "statements": len(every),
        "integrals": len(integrals) + sum(isinstance(s, Sample) or type(s) in STATEMENTS for s in every),
        "isolations": sum(isinstance(s, Isolate | Locate) for s in every),
        "evaluations": _evaluations(program.body, hints),
        "least": _least(program.body),
        "adaptive": any(isinstance(s.rule, Adaptive) for s in integrals),
    }


def _evaluations(block: Iterable[Stmt], hints: Container[Arg]) -> int:
    """Returns the evaluations of integrands without inner integrals, with all breaks inside the bounds except hints, of which few occur.

    A search for roots evaluates no integrand, nor does a sum over them.
    """
    total = 0
    for stmt in block:
        match stmt:
            case Integrate():
                once = _evaluations(stmt.flags, hints) + _nodes_a_piece(stmt.rule) * (_evaluations(stmt.body, hints) or 1)
                total += (1 + sum(b not in hints for b in stmt.breaks)) * once
            case When():
                total += _evaluations(stmt.body, hints)
            case SumOver():
                total += len(stmt.points) * _evaluations(stmt.body, hints)
            case Sample():
                replicates, points = replicated(stmt.kind, stmt.count)
                total += replicates * points * (_evaluations(stmt.body, hints) or 1)
            case _ if type(stmt) in STATEMENTS:
                total += STATEMENTS[type(stmt)].evaluations(stmt)
            case _:
                continue
    return total


def _least(block: Iterable[Stmt]) -> int:
    """Returns the least evaluations that the rules of a block can do with: no break inside the bounds, and first looks that are enough."""
    total = 0
    for stmt in block:
        match stmt:
            case Integrate():
                total += _least(stmt.flags) + _nodes_a_piece(stmt.rule) * (_least(stmt.body) or 1)
            case When():
                total += _least(stmt.body)
            case SumOver():
                total += _least(stmt.body) if stmt.points else 0
            case Sample():
                replicates, points = replicated(stmt.kind, stmt.count)
                total += replicates * points * (_least(stmt.body) or 1)
            case _ if type(stmt) in STATEMENTS:
                total += STATEMENTS[type(stmt)].least(stmt)
            case _:
                continue
    return total
