"""What other packages call the names of this one, and what is written in this language where they have a name: for the hints of errors."""

from __future__ import annotations

OTHER_NAMES = {
    "integrate": "integral", "Integral": "integral", "heaviside": "bracket", "indicator": "bracket", "step": "bracket",
    "max": "maximum", "min": "minimum", "select": "where", "if_else": "where", "cond": "where", "Piecewise": "where",
    "arctan": "atan", "arctan2": "atan2", "arcsin": "asin", "arccos": "acos", "pow": "sqrt, and ** for powers", "ln": "log",
    "gradient": "grad", "derivative": "diff", "variable": "var", "parameter": "param", "symbols": "vars and teg.params",
    "product": "prod", "argmin": "nearest", "jit": "compile", "subs": "substitute", "lambdify": "compile", "eval": "evaluate",
    "dirac": "delta", "Dirac": "delta", "sgn": "sign", "fabs": "abs", "jacobian": "grad, of a tuple",
    "absolute": "abs", "fmin": "minimum", "fmax": "maximum", "rint": "round",
}  # fmt: skip
"""What other packages call the names of this one, for the hint of an AttributeError."""

WRITTEN = {
    "inf": "math.inf", "Inf": "math.inf", "infinity": "math.inf", "oo": "math.inf", "pi": "math.pi", "e": "math.e", "nan": "math.nan",
    "clip": "teg.minimum(teg.maximum(u, lo), hi)", "clamp": "teg.minimum(teg.maximum(u, lo), hi)", "relu": "teg.maximum(u, 0)",
    "power": "u**p", "square": "u**2", "hypot": "teg.sqrt(u**2 + v**2)", "log2": "teg.log(u) / math.log(2)",
    "log10": "teg.log(u) / math.log(10)", "cbrt": "u**(1/3), for u >= 0", "argmax": "teg.nearest(k, -key, (k, 0, n))",
    "logical_and": "c & d", "logical_or": "c | d", "logical_not": "~c", "vjp": "teg.compile(e).vjp(…)", "hvp": "teg.compile(e).hvp(…)",
    "value_and_grad": "teg.compile(e).value_and_grad(…)", "logical_xor": "(c & ~d) | (~c & d)", "reciprocal": "1 / u", "exp2": "2**u",
    "arcsinh": "teg.log(u + teg.sqrt(u**2 + 1))", "deg2rad": "u * math.pi / 180", "radians": "u * math.pi / 180",
}  # fmt: skip
"""What is written in this language where other packages have a name."""

SHARED = frozenset((
    "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "sqrt", "erf", "erfc", "floor", "ceil", "sign", "maximum",
    "minimum",
))  # fmt: skip
"""Functions that have the same name in NumPy or SciPy."""


def ours(name: str) -> str:
    """Returns how this language writes a function of NumPy or SciPy, as "teg.asin" or "u**2"; empty where it has none."""
    if name in SHARED:
        return f"teg.{name}"
    return f"teg.{OTHER_NAMES[name]}" if name in OTHER_NAMES else WRITTEN.get(name, "")
