# mypy: disallow-subclassing-any=False, disallow-untyped-calls=False
"""Programs and all their derivatives as one `torch.autograd.Function`.

    D(p; u₁, …, uₖ)       applied with the kernels of a program and the order k

    k = -1    the values e(p)
    k = 0     the values and the gradients ∂e/∂p, by one program: they share their loops
    k ≥ 1     Dᵏ⁺¹e(p)[u₁, …, uₖ, ·], of the structure of p; of a single e

Its rules are closed under differentiation, as those of the primitive of JAX are (`jax/derivative.py`): with cotangents c of the values and
d of the gradients, or of what has the structure of p,

    backward of (e, ∂e)        p̄ = c·∂e + D(p; d)
    backward of D(p; u…)       p̄ = D(p; u…, d),    ūᵢ = D(p; …, d, …) with d in the place of uᵢ, for Dᵏ⁺¹e is symmetric
    forward                    the same with ṗ, u̇ᵢ for d

The gradients are outputs, which the backward pass saves: so a derivative of theirs comes back to the node that made them, as d. Programs
run on arrays of NumPy that are views of the tensors, in double precision; every operand has the axes of the batch in front of its own,
those that it does not depend on with stride 0. This module imports PyTorch.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence
from typing import Any, Protocol, cast

import torch
from torch.autograd import forward_ad

Tensors = Sequence[Any]


class Kernels(Protocol):
    """The programs of a function, `teg.evaluator.kernels.DerivativeKernels`: how many of the operands are differentiated by, the first
    ones; how many values there are; how many axes each operand has, without directions; and how to run them."""

    moving: int
    entries: int
    dimensions: tuple[int, ...]

    def run(self, order: int, entry: int | None, operands: Sequence[Any], n: int) -> list[Any]: ...


def values(kernels: Kernels, front: int, dtype: Any, operands: Tensors) -> tuple[Any, ...]:
    """Returns the values, tensors of the batch's shape, its `front` axes, and of the type `dtype`, which the operands that are
    differentiated by have too. Where one of these requires a gradient, it is computed with the values."""
    wanted = torch.is_grad_enabled() and any(v.requires_grad for v in operands[: kernels.moving])
    found = Derivative.apply(kernels, None, 0 if wanted else -1, front, dtype, *operands)
    return tuple(found[: kernels.entries])


class Derivative(torch.autograd.Function):
    """D(p; u₁, …, uₖ) on operands that are the leaves of p, the moving ones first, its constants, and then the moving leaves of each u;
    `front` axes of each are the batch's. With k ≥ 1 of the value number `entry`."""

    @staticmethod
    def forward(kernels: Kernels, entry: int | None, order: int, front: int, dtype: Any, *operands: Any) -> tuple[Any, ...]:
        shapes = _shapes(kernels, order, front, operands)
        batch = tuple(operands[0].shape[:front]) if operands else ()
        n = math.prod(batch)
        if n == 0:
            return tuple(torch.zeros((*batch, *shape), dtype=dtype) for shape in shapes)
        arrays = [_array(v, front, n) for v in operands]
        results = kernels.run(order, entry, arrays, n)
        found = [torch.from_numpy(v.reshape((*batch, *shape))).to(dtype) for v, shape in zip(results, shapes, strict=True)]
        if order == 0:  # a value that is kept does not keep the gradients
            found[: kernels.entries] = [v.clone() for v in found[: kernels.entries]]
        return tuple(found)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Any, ...]) -> None:
        ctx.kernels, ctx.entry, ctx.order, ctx.front, ctx.dtype, *operands = inputs
        ctx.count = len(operands)
        slopes = output[ctx.kernels.entries :] if ctx.order == 0 else ()
        ctx.save_for_backward(*operands, *slopes)
        ctx.save_for_forward(*operands, *slopes)
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> tuple[Any, ...]:
        rule = _Rule(ctx)
        needed = ctx.needs_input_grad[5:]
        found: list[Any] = [None] * ctx.count

        def add(first: int, parts: Tensors) -> None:
            for i, part in enumerate(parts, first):
                if part is not None and needed[i]:
                    found[i] = part if found[i] is None else found[i] + part

        moving = range(rule.moving)
        if ctx.order > 0:
            along = rule.filled(cotangents)
            if along is not None:
                if any(needed[i] for i in moving):
                    add(0, rule.of(ctx.order + 1, rule.operands + along))
                for slot in rule.slots:
                    if any(needed[slot]):
                        add(slot.start, rule.of(ctx.order, rule.replaced(slot, along)))
        elif any(needed[i] for i in moving):
            for entry, cotangent in enumerate(cotangents[: rule.entries]):
                if cotangent is not None:
                    slopes = rule.slopes(entry)
                    add(0, [rule.times(cotangent, slopes[i]) if needed[i] else None for i in moving])
            for entry in range(rule.entries if ctx.order == 0 else 0):
                along = rule.filled(cotangents[rule.entries + entry * rule.moving :][: rule.moving])
                if along is not None:
                    add(0, rule.of(1, rule.operands + along, entry))
        return (None,) * 5 + tuple(found)

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> tuple[Any, ...]:
        with forward_ad._set_fwd_grad_enabled(True):  # PyTorch turns it off here, and the tangents of outer levels would be lost
            return tuple(_Rule(ctx, primals=True).pushed(tangents[5:]))

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], *arguments: Any) -> tuple[tuple[Any, ...], Any]:
        kernels, entry, order, front, dtype, *operands = arguments
        n = info.batch_size
        moved = [
            v.unsqueeze(0).expand((n, *v.shape)) if axis is None else v.movedim(axis, 0)
            for v, axis in zip(operands, in_dims[5:], strict=True)
        ]
        if order < 0 and moved:
            found = values(kernels, front + 1, dtype, moved)
        else:
            found = Derivative.apply(kernels, entry, order, front + 1, dtype, *moved)
        return found, (0 if moved else None,) * len(found)


cast(Any, Derivative.forward).__signature__ = inspect.signature(Derivative.forward)  # which PyTorch would look for at every call


class _Rule:
    """The data of the rules of one application. With `primals` the saved values are without the tangents that they carry themselves."""

    def __init__(self, ctx: Any, primals: bool = False) -> None:
        self.kernels, self.front, self.dtype, self.order, self.entry = ctx.kernels, ctx.front, ctx.dtype, ctx.order, ctx.entry
        self.moving, self.entries = self.kernels.moving, self.kernels.entries
        saved = [forward_ad.unpack_dual(v).primal for v in ctx.saved_tensors] if primals else list(ctx.saved_tensors)
        self.operands = saved[: ctx.count]
        self._slopes: Tensors = saved[ctx.count :]
        given = len(self.kernels.dimensions)
        self.slots = [slice(first, first + self.moving) for first in range(given, ctx.count, self.moving or 1)]

    def of(self, order: int, operands: Tensors, entry: int | None = None) -> list[Any]:
        """Returns a derivative on operands, a node of the graph as this one is."""
        return list(Derivative.apply(self.kernels, self.entry if entry is None else entry, order, self.front, self.dtype, *operands))

    def slopes(self, entry: int) -> Tensors:
        """Returns the gradient of a value; where the values were computed alone, now."""
        if self.order < 0 and not self._slopes:
            self._slopes = self.of(0, self.operands)[self.entries :]
        return self._slopes[entry * self.moving :][: self.moving]

    def zeros(self) -> list[Any]:
        return [torch.zeros_like(v) for v in self.operands[: self.moving]]

    def filled(self, changes: Tensors) -> list[Any] | None:
        """Returns changes of what has the structure of p, zeros written out; None where all are 0."""
        if all(c is None for c in changes):
            return None
        leaves = self.operands[: self.moving]
        return [torch.zeros((), dtype=self.dtype).expand(v.shape) if c is None else c for c, v in zip(changes, leaves, strict=True)]

    def replaced(self, slot: slice, change: Tensors) -> list[Any]:
        """Returns the operands with another direction in one place."""
        return [*self.operands[: slot.start], *change, *self.operands[slot.stop :]]

    def pushed(self, tangents: Tensors) -> list[Any]:
        """Returns the tangents of the results."""
        moved = self.filled(tangents[: self.moving])
        if self.order <= 0:
            changes = [self.inner(self.slopes(entry), tangents[: self.moving]) for entry in range(self.entries)]
            for entry in range(self.entries if self.order == 0 else 0):
                changes += self.zeros() if moved is None else self.of(1, self.operands + moved, entry)
            return changes
        terms = [] if moved is None else [self.of(self.order + 1, self.operands + moved)]
        for slot in self.slots:
            change = self.filled(tangents[slot])
            if change is not None:
                terms.append(self.of(self.order, self.replaced(slot, change)))
        return [sum(parts[1:], start=parts[0]) for parts in zip(*terms, strict=True)] if terms else self.zeros()

    def times(self, number: Any, slope: Any) -> Any:
        """Returns a number times a gradient, of every element of the batch."""
        return number.reshape((*number.shape, *(1,) * (slope.ndim - number.ndim))) * slope

    def inner(self, slopes: Tensors, tangents: Tensors) -> Any:
        """Returns ⟨∂e, dp⟩ of every element of the batch."""
        terms = [
            (slope * tangent).sum(tuple(range(self.front, slope.ndim))) if slope.ndim > self.front else slope * tangent
            for slope, tangent in zip(slopes, tangents, strict=True)
            if tangent is not None
        ]
        if not terms:
            return torch.zeros(self.operands[0].shape[: self.front], dtype=self.dtype)
        return sum(terms[1:], start=terms[0])


def _shapes(kernels: Kernels, order: int, front: int, operands: Tensors) -> list[tuple[int, ...]]:
    """Returns the shape of each result for one element of the batch."""
    leaves = [tuple(v.shape[front:]) for v in operands[: kernels.moving]]
    return ([()] * kernels.entries if order <= 0 else []) + leaves * (kernels.entries if order == 0 else int(order > 0))


def _array(operand: Any, front: int, n: int) -> Any:
    """Returns an operand as a kernel reads it: a view wherever it is one of doubles that lie row by row."""
    operand = operand.detach()
    strides, shape = operand.stride(), operand.shape
    if all(strides[k] == 0 or shape[k] == 1 for k in range(front)):
        operand = operand[(0,) * front]
    else:
        operand = operand.reshape((n, *shape[front:]))
    kind = torch.float64 if operand.is_floating_point() else torch.int64
    return operand.to(kind).contiguous().numpy(force=True)
