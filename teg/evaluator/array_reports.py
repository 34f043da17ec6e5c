"""What the evaluator of a program with arrays says about a call: missed tolerances, estimates of errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

from teg.evaluator.accuracy import report_missed, report_not_a_number
from teg.evaluator.arguments import with_rounding
from teg.evaluator.options import Options
from teg.ir.expr import Expr, Tuple
from teg.program import Sample, statements
from teg.program.arrays import ArrayProgram, Run, steps

if TYPE_CHECKING:
    import numpy as np


def has_samples(program: ArrayProgram) -> bool:
    """Whether integrals of a program are sampled."""
    flat = (s.program for s in steps(program.body) if isinstance(s, Run))
    return any(isinstance(s, Sample) for p in flat for s in statements(p.body))


def places(e: Expr, name: str) -> list[str]:
    """The name of each entry of a tuple expression, nested ones in order."""
    if not isinstance(e, Tuple):
        return [name]
    return [place for i, entry in enumerate(e.children) for place in places(entry, f"{name}[{i}]")]


def paired(found: Sequence[np.ndarray], dtype: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Results, each with the estimate of its error, of a run with estimates; as float32 the latter hold the rounding as well."""
    import numpy as np

    count = len(found) // 2
    pairs = list(zip(found[:count], found[count:], strict=True))
    if dtype == "float64":
        return pairs
    short = [with_rounding(np.stack(pair)) for pair in pairs]
    return [(both[0], both[1]) for both in short]


def report_arrays(
    found: Sequence[np.ndarray],
    names: Sequence[str],
    options: Options,
    given: Mapping[str, tuple[Any, int]],
    shape: tuple[int, ...],
    sampled: bool,
) -> bool:
    """Warn of the worst entry of the results of a run with estimates, or raise: `found` are the results, (n, *shape of one), and then the
    estimates; `names` say what each result is, `given` are the values of parameters and arrays with their dimensions, for a batch of
    `shape`. Elements that are given something infinite, or no number, are passed over. Returns whether there was anything to say."""
    import numpy as np

    count = len(found) // 2
    values, errors = (_rows(half) for half in (found[:count], found[count:]))
    meant, parameters = _meant(given, shape, len(found[0]), np.isfinite)
    if not meant.any():
        return False
    titles = _Titles(names, [v.shape[1:] for v in found[:count]])
    how = options.integration.tol, options.inaccurate
    return report_missed(values[:, meant], errors[:, meant], titles, *how, parameters, sampled)


def report_missing(
    found: Sequence[np.ndarray],
    names: Sequence[str],
    options: Options,
    given: Mapping[str, tuple[Any, int]],
    shape: tuple[int, ...],
    crowded: bool,
) -> bool:
    """The same of an entry of the results that is no number though all that was given is; `found` are the results only."""
    import numpy as np

    if not any(np.isnan(v).any() for v in found):
        return False
    meant, parameters = _meant(given, shape, len(found[0]), lambda v: ~np.isnan(v))
    if not meant.any():
        return False
    titles = _Titles(names, [v.shape[1:] for v in found])
    return report_not_a_number(_rows(found)[:, meant], titles, options.inaccurate, parameters, crowded)


def _rows(found: Sequence[np.ndarray]) -> np.ndarray:
    """Every entry of results (n, *shape of one) as a row."""
    import numpy as np

    return np.concatenate([np.moveaxis(v, 0, -1).reshape(-1, len(v)) for v in found])


def _meant(
    given: Mapping[str, tuple[Any, int]], shape: tuple[int, ...], n: int, usable: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Which elements of a batch are given `usable` numbers only, and the values of parameters there."""
    import numpy as np

    meant = np.ones(n, dtype=bool)
    shown: dict[str, np.ndarray] = {}
    for name, (v, dimensions) in given.items():
        entries = np.asarray(v, dtype=np.float64)
        leading = entries.shape[: entries.ndim - dimensions]
        good = usable(entries).reshape(*leading, -1).all(axis=-1)
        meant &= np.broadcast_to(good, shape).reshape(n)
        if not dimensions:
            shown[name] = np.broadcast_to(entries, shape).reshape(n) if shape else entries
    return meant, {k: v if v.ndim == 0 else v[meant] for k, v in shown.items()}


class _Titles(Sequence[str]):
    """What each entry of each result is, made when it is asked for."""

    def __init__(self, names: Sequence[str], shapes: Sequence[tuple[int, ...]]) -> None:
        import numpy as np

        self.names, self.shapes = names, shapes
        self.ends = np.cumsum([int(np.prod(s)) for s in shapes])

    def __len__(self) -> int:
        return int(self.ends[-1])

    @overload
    def __getitem__(self, i: int) -> str: ...
    @overload
    def __getitem__(self, i: slice) -> list[str]: ...
    def __getitem__(self, i: int | slice) -> str | list[str]:
        import numpy as np

        if isinstance(i, slice):
            return [self[k] for k in range(*i.indices(len(self)))]
        j = int(np.searchsorted(self.ends, i, side="right"))
        if not self.shapes[j]:
            return self.names[j]
        place = np.unravel_index(i - (int(self.ends[j - 1]) if j else 0), self.shapes[j])
        return f"{self.names[j]}[{', '.join(map(str, map(int, place)))}]"
