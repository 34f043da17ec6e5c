"""`teg.torch_function`: a program as a function of PyTorch, with correct derivatives of any order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from teg.analysis.isolation import MAX_ROOTS
from teg.analysis.settings import Integration, Rule
from teg.errors import ArrayIndexError, MissingPackageError, OptionError, ParameterError
from teg.evaluator.arguments import batch_shape
from teg.evaluator.framework import (
    KEPT,
    FrameworkFunction,
    Parameter,
    check_entries,
    checked_expression,
    nested,
)
from teg.evaluator.kept import Kept
from teg.evaluator.kernels import DerivativeKernels, dimensions_of
from teg.evaluator.options import DEFAULT_TOLS, Discontinuities, Inaccurate, Jumps, Machine, Options, checked_dtype
from teg.evaluator.plan import Plan
from teg.ir.expr import Expr, Operand, Param
from teg.ir.index import ArrayName, IndexArray
from teg.passes.differentiate.through_sums import parameters_and_arrays
from teg.report.explanation import SHOWN, shortened

if TYPE_CHECKING:
    import torch

OLDEST = (2, 4)
"""The first supported version of PyTorch."""
BACKENDS = ("numpy", "c")


def torch_function(
    e: Operand,
    params: Sequence[Parameter] | Parameter | None = None,
    *,
    indices: Mapping[Any, Any] | None = None,
    dtype: object = None,
    backend: Literal["numpy", "c"] = "numpy",
    threads: int = 1,
    memory: int = 256 * 2**20,
    tol: float | None = None,
    rule: Rule = "auto",
    order: int | None = None,
    seed: int = 0,
    inaccurate: Inaccurate = "warn",
    discontinuities: Discontinuities = "exact",
    max_roots: int = MAX_ROOTS,
    maps: Sequence[Any] = (),
    check_maps: bool = True,
    intrinsics: bool = True,
) -> TorchFunction:
    """Returns a function of PyTorch: from a dict of parameters and arrays by name to the value, a tensor, or a tuple of values.

        f = teg.torch_function(e)
        s = torch.tensor(0.5, requires_grad=True)
        f(t=s, a=2.0).backward()
        float(s.grad)                             # 0.25

    It is differentiable to any order, in reverse, forward, and by `torch.func` (`grad`, `vmap`, `jvp`, `hessian` and so on). Derivatives
    are programs made of the symbolic derivative, each made once, when it is first needed. Where a tensor requires a gradient, one run
    computes it with the value; where none does, no program of a gradient is made.

    Values are tensors, NumPy arrays or numbers, and broadcast as those of an evaluator do: a number may be a tensor of the batch's
    shape, an array has the batch's axes in front. Derivatives are taken by `params` (default: all real parameters and arrays); the
    others are constants, as if detached. A gradient is computed by all of `params` or by none, so leave out parameters that never move.
    Integer parameters and `teg.indices` may be given at the call, or here by `indices=`.

    `dtype` is "float32" or "float64" or a type of PyTorch. Parameter values are rounded to it, and results have it. None: the type that
    PyTorch gives to a sum of the arguments (float16 and bfloat16 too; its default type for Python's numbers alone). Intermediate values
    are float64. Programs run on the CPU: tensors of other devices are copied there, and results back.

    The other options are those of `teg.compile`. `torch.compile` leaves a call between two graphs. `torch.func.hessian` maps second
    derivatives over a batch; `torch.autograd.functional` with `vectorize=True` cannot, because it does not support user functions.

    Raises MissingPackageError without PyTorch, ParameterError for values that are missing, unknown, of wrong shapes, not real numbers or
    on several devices, ArrayIndexError for indices out of range, OptionError for an unknown option. A call may warn of a missed
    tolerance (AccuracyWarning), depending on `inaccurate`.
    """
    program = checked_expression(e)
    _import_torch()  # the next line reads types of PyTorch
    precision = None if dtype is None else checked_dtype(_name_of_type(dtype))
    if backend not in BACKENDS:
        raise OptionError(f"backend={backend!r} is not for PyTorch", None, "one of: " + ", ".join(BACKENDS))
    integration = Integration(DEFAULT_TOLS[precision or "float64"] if tol is None else tol, rule, order, seed, max_roots, intrinsics)
    machine, jumps = Machine(backend, threads, memory), Jumps(discontinuities, maps, check_maps)
    options = Options(machine, integration, inaccurate, "float64", jumps)
    wrt = None if params is None else parameters_and_arrays(params)
    return TorchFunction(program, wrt, options, precision, indices or {})


class TorchFunction(FrameworkFunction):
    """A function of PyTorch made by `teg.torch_function`. Call it with a dict, or by name; `parameters` are the names of its arguments.

        float(teg.torch_function(e)(t=0.5, a=2.0))  # 0.0625

    It may be shared between threads, and pickles, and so does a module that holds it.
    """

    framework = "PyTorch"

    def __init__(self, e: Expr, wrt: Sequence[Parameter] | None, options: Options, dtype: str | None, indices: Mapping[Any, Any]) -> None:
        _import_torch()
        super().__init__(e, wrt, options, dtype, indices)
        self._compiled: Kept[Plan, DerivativeKernels] = Kept(KEPT)
        if self._plan is not None:
            self._kernels_of(self._plan)

    def __repr__(self) -> str:
        return f"<teg.torch_function({', '.join(self.parameters)}) of {shortened(str(self.expression), SHOWN)} on {self._options.backend}>"

    def __call__(self, values: Mapping[str, Any] | None = None, /, **named: Any) -> Any:
        """Returns the value, a tensor of the batch's shape; for a tuple expression a tuple."""
        import torch

        if torch.compiler.is_compiling():
            from teg.backends.torch.graphs import outside_of_graphs

            return outside_of_graphs(self._called, values, named)
        return self._called(values, named)

    def _called(self, values: Mapping[str, Any] | None, named: Mapping[str, Any]) -> Any:
        from teg.backends.torch import derivative as backend

        call = self._arguments(self._values(values, named))
        arrays = {p: tuple(v.shape[call.front :]) for p, v in zip(self._leaves, call.operands, strict=False) if isinstance(p, ArrayName)}
        whole = {p.name for p in (*self._leaves, *self._integers) if isinstance(p, IndexArray) or p in self._integers}
        known = {name: v.numpy() for name, v in zip(self.parameters, call.operands, strict=True) if name in whole}
        kernels = self._kernels_of(self._plan_for(arrays, known))
        results = backend.values(kernels, call.front, call.dtype, call.operands)
        return nested(self.expression, iter([v.to(call.device) for v in results]))

    def _kernels_of(self, plan: Plan) -> DerivativeKernels:
        return self._compiled.get(plan, lambda: DerivativeKernels(plan))

    def _arguments(self, by_name: Mapping[str, Any]) -> _Call:
        """Returns the arguments of a call in the form of `teg.backends.torch.derivative`: on the CPU, of one type, with the batch's axes in
        front."""
        import torch

        names = (*self._leaves, *self._integers)
        tensors = [_tensor(p, by_name[p.name]) for p in names]
        real = [(v, by_name[p.name]) for p, v in zip(self._leaves, tensors, strict=False) if not isinstance(p, IndexArray)]
        dtype = getattr(torch, self._dtype) if self._dtype else _common_type(real)
        device = _common_device([v for v, _ in real])
        fronts = [tuple(v.shape[: v.ndim - dimensions_of(p)]) for p, v in zip(names, tensors, strict=True)]
        batch = batch_shape([p.name for p in names], fronts)
        operands = []
        for i, (p, v, front) in enumerate(zip(names, tensors, fronts, strict=True)):
            kind = torch.int64 if isinstance(p, IndexArray) else dtype if i < len(self._leaves) else torch.float64
            v = v if i < len(self.wrt) else v.detach()
            operands.append(v.to(device="cpu", dtype=kind).expand((*batch, *v.shape[len(front) :])))
        return _Call(operands, len(batch), dtype, device)


class _Call(NamedTuple):
    """Operands, the number `front` of their leading batch axes, and type and device of results."""

    operands: list[Any]
    front: int
    dtype: Any
    device: Any


def _tensor(p: Param | ArrayName, value: Any) -> torch.Tensor:
    """Returns a value as a checked tensor. A tensor is itself, NumPy arrays keep their type, and Python's numbers are double or integer."""
    import torch

    if isinstance(value, torch.Tensor):
        tensor = value
        if value.layout != torch.strided or value.device.type == "meta":
            what = "has no values" if value.device.type == "meta" else f"has the layout {value.layout}"
            raise ParameterError(f"the tensor given for {p.name!r} {what}", None, "give a dense tensor")
    else:
        if isinstance(value, list | tuple) and any(isinstance(v, torch.Tensor) for v in value):
            raise ParameterError(f"the value of {p.name!r} is a list of tensors", None, "torch.stack makes one tensor of them")
        tensor = _of_numbers(p, value)
    if isinstance(p, IndexArray) and not tensor.numel():
        tensor = tensor.to(torch.int64)
    kind = "f" if tensor.is_floating_point() else "" if tensor.is_complex() else "b" if tensor.dtype == torch.bool else "i"
    check_entries(p, kind, tensor.dtype, tuple(tensor.shape), "use .long()")
    return tensor


def _of_numbers(p: Param | ArrayName, value: Any) -> torch.Tensor:
    """Returns Python's numbers, lists of them, and NumPy arrays as a tensor."""
    import numpy as np
    import torch

    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
        if array.dtype.kind == "u" and array.size and array.max() > np.iinfo(np.int64).max:
            if isinstance(p, IndexArray):
                raise ArrayIndexError(f"an entry of {p.name!r} is too large for an index: {array.max()}")
            array = array.astype(np.float64)
        kind = {"i": "int64", "u": "int64", "b": "bool"}.get(array.dtype.kind, array.dtype.name if array.dtype.itemsize <= 8 else "float64")
        return torch.tensor(array.astype(kind, copy=False))  # a copy, so that a backward pass finds it unchanged
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"the value of {p.name!r} is not a real number or an array of them: {value!r:.80}") from None


def _common_type(values: Sequence[tuple[torch.Tensor, Any]]) -> Any:
    """Returns the floating type of a sum of values, given as tensors and as they were, by PyTorch's rules.

    A tensor with axes precedes one without, and that precedes Python's numbers.
    """
    import numpy as np
    import torch

    typed = [v for v, original in values if v.is_floating_point() and isinstance(original, torch.Tensor | np.ndarray)]
    kinds = [v.dtype for v in typed if v.ndim] or [v.dtype for v in typed]
    return reduce(torch.promote_types, kinds) if kinds else torch.get_default_dtype()


def _common_device(tensors: Sequence[torch.Tensor]) -> Any:
    """Returns the device of the tensors of a call. Single numbers may also be on the CPU."""
    import torch

    devices = dict.fromkeys(v.device for v in tensors if v.ndim or v.device.type != "cpu")
    if len(devices) > 1:
        text = " and ".join(map(str, devices))
        raise ParameterError(f"tensors of one call lie on {text}", None, "move them to one device: tensor.to(device)")
    return next(iter(devices), torch.device("cpu"))


def _name_of_type(dtype: object) -> object:
    """Returns a type of PyTorch as a name; anything else as it is."""
    import torch

    return str(dtype).removeprefix("torch.") if isinstance(dtype, torch.dtype) else dtype


def _import_torch() -> None:
    try:
        import torch
    except ImportError:
        raise MissingPackageError("the package torch is not installed", None, 'pip install "teg-compiler[torch]"') from None
    version = tuple(int(part) for part in torch.__version__.split("+")[0].split(".")[:2])
    if version < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise MissingPackageError(
            f"teg.torch_function needs PyTorch {oldest} or later, and this is {torch.__version__}", None, "pip install -U torch"
        )
