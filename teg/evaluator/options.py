"""The options of a compilation, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast, get_args

from teg.analysis.settings import DEFAULT_TOL, Integration, is_whole
from teg.errors import EstimatorError, OptionError
from teg.ir.arrays import Array, has_arrays
from teg.ir.expr import Expr
from teg.language.checks import check_parameters
from teg.maps.diffeomorphism import Diffeomorphism, checked_maps
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.through_sums import Parameter, parameters_and_arrays
from teg.pipeline import estimator_for

if TYPE_CHECKING:
    import numpy as np

Backend = Literal["numpy", "c", "jax"]
Discontinuities = Literal["exact", "sift", "ignore", "differences", "spsa", "edge-mc", "warp", "warp-blur", "smooth"]
Inaccurate = Literal["warn", "raise", "ignore"]
Functions = Literal["linked", "inlined"]
DType: TypeAlias = "Literal['float64', 'float32'] | type | np.dtype[Any]"
"""The types of options."""
BACKENDS = get_args(Backend)
INACCURATE = get_args(Inaccurate)
FUNCTIONS = get_args(Functions)
DTYPES = ("float64", "float32")
"""The types of parameters and results. All intermediate values are float64."""
DEFAULT_TOLS = {"float64": DEFAULT_TOL, "float32": 1e-6}


class Machine(NamedTuple):
    """The backend, the number of threads, and the bytes of temporary arrays."""

    backend: str
    threads: int = 1
    memory: int = 2**28


class Jumps(NamedTuple):
    """What is done with the jumps of a derivative: the estimator or its name, maps for surfaces, and whether calls verify these."""

    discontinuities: str | Estimator
    maps: Sequence[Diffeomorphism] = ()
    check_maps: bool = False


class Options:
    """Checked options of a compilation; `teg.compile` documents them. Raises OptionError for a value outside of its range."""

    def __init__(
        self,
        machine: Machine,
        integration: Integration,
        inaccurate: str,
        dtype: object,
        jumps: Jumps,
        functions: str = "linked",
    ) -> None:
        (backend, threads, memory), (discontinuities, maps, check_maps) = machine, jumps
        if backend not in BACKENDS:
            raise OptionError(f"backend={backend!r} is not known", None, "one of: " + ", ".join(BACKENDS))
        if inaccurate not in INACCURATE:
            raise OptionError(f"inaccurate={inaccurate!r} is not known", None, "one of: " + ", ".join(map(repr, INACCURATE)))
        if not is_whole(threads) or threads < 0:
            raise OptionError(f"threads={threads!r} is not a number of threads", None, "1, 2, …, or 0 for one a processor")
        if not is_whole(memory) or memory < 2**16:
            raise OptionError(f"memory={memory!r} is not a number of bytes of at least 65536")
        if functions not in FUNCTIONS:
            raise OptionError(f"functions={functions!r} is not known", None, "one of: " + ", ".join(map(repr, FUNCTIONS)))
        self.dtype, self.functions = checked_dtype(dtype), functions
        self.backend, self.threads, self.memory = backend, int(threads), int(memory)
        self.integration, self.inaccurate = integration, inaccurate
        self.estimator = discontinuities if isinstance(discontinuities, Estimator) else estimator_for(discontinuities, how=integration)
        self.maps, self.check_maps = checked_maps(maps), bool(check_maps)


def rule_for(estimator: Estimator, backend: str, rule: str, order: int | None, samples: int | None) -> tuple[str, int | None]:
    """Returns the rule and the order of a compilation: samples, for an estimator that is sampled, unless the user names a rule.

    Raises OptionError for `samples` beside `order` or without a rule that samples, EstimatorError for a backend that estimators do not
    know.
    """
    name = estimator.name
    if backend == "jax" and not estimator.has_all_orders:
        raise EstimatorError(f'discontinuities={name!r} is not available with backend="jax"', None, '"numpy" and "c" have it')
    if rule == "auto" and (estimator.is_sampled or (samples is not None and not isinstance(estimator, Exact))):
        rule = "montecarlo"
    if samples is None:
        return rule, order
    if not is_whole(samples) or samples < 1:
        raise OptionError(f"samples={samples!r} is not a number of samples", None, "a whole number above 0")
    if order is not None:
        raise OptionError("samples= and order= say the same", None, "give one of them")
    if rule not in ("montecarlo", "qmc"):
        hint = 'rule="montecarlo" and rule="qmc" sample; every discontinuities= but "exact" does so unless a rule is given'
        raise OptionError(f"samples={samples!r} has no meaning here: the rule {rule!r} does not sample", None, hint)
    return rule, samples


def parameters_of(e: Expr, wrt: object) -> Sequence[Parameter]:
    """Returns a user's list of parameters of a program. Arrays that the program does not read may be among them. Raises ParameterError."""
    has_array = isinstance(wrt, Array) or (isinstance(wrt, list | tuple) and any(isinstance(p, Array) for p in wrt))
    return parameters_and_arrays(wrt) if has_array or has_arrays(e) else check_parameters(wrt)


def checked_dtype(dtype: object) -> str:
    """Returns the name of a dtype: "float64" or "float32", for these names, NumPy's types and their equivalents."""
    if isinstance(dtype, str) and dtype in DTYPES:
        return dtype
    import numpy as np  # imported here, so that `import teg` stays fast

    try:
        name = np.dtype(cast(Any, dtype)).name if dtype is not None else "None"
    except TypeError:
        name = ""
    if name not in DTYPES:
        raise OptionError(f"dtype={dtype!r} is not available", None, "one of: " + ", ".join(map(repr, DTYPES)))
    return name
