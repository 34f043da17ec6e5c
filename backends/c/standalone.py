"""A program as a pair of C files for use without Python, with the description of every input, array and output.

    standalone_c(program, name)  ->  the texts of name.c and name.h

They are C99, and need the C library and its mathematics only: `cc -std=c99 -O2 name.c … -lm`, with -fopenmp for threads.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from teg.backends.c.batch import ABI
from teg.backends.c.loops import print_arrays
from teg.backends.c.text import harmless
from teg.backends.c.unit import print_kernel
from teg.errors import OptionError
from teg.program import Program
from teg.program.arrays import ArrayProgram, ArraySpec, Integers, Like, steps

_WORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register restrict
    return short signed sizeof static struct switch typedef union unsigned void volatile while and and_eq asm bitand bitor bool
    catch class compl delete dynamic_cast explicit export false friend mutable namespace new not not_eq operator or or_eq private
    protected public reinterpret_cast static_cast template this throw true try typeid typename using virtual wchar_t xor xor_eq
    main linux unix abort abs atexit atof atoi atol atoll bsearch calloc div exit free getenv labs ldiv llabs lldiv malloc mblen
    mbstowcs mbtowc qsort rand realloc srand strtod strtof strtol strtold strtoll strtoul strtoull system wcstombs wctomb random
    srandom drand48 printf scanf puts gets index rindex memcpy memset memcmp memchr memmove strlen strcpy strcmp strcat strchr strcoll
    strcspn strerror strncat strncmp strncpy strpbrk strrchr strspn strstr strtok strxfrm math_errhandling NULL NAN INFINITY
    alloca aligned_alloc at_quick_exit bcmp bcopy bzero clearenv ecvt fcvt gcvt ffs ffsl ffsll getloadavg getsubopt initstate setstate
    memccpy mkdtemp mkstemp mktemp on_exit pselect putenv quick_exit realpath reallocarray rpmatch select setenv signgam stpcpy
    stpncpy strcasecmp strdup strncasecmp strndup strnlen strsep strsignal uint ulong unsetenv ushort valloc
"""
WORDS = frozenset(_WORDS.split())
"""Words of C and C++, and what headers of the C library and of POSIX declare without a suffix."""
_MATHEMATICS = """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor fma fmax fmin fmod
    frexp gamma hypot ilogb j0 j1 jn ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround modf nan nearbyint
    nextafter nexttoward pow remainder remquo rint round scalbln scalbn sin sinh sqrt tan tanh tgamma trunc y0 y1 yn fpclassify
    isfinite isinf isnan isnormal signbit isgreater isgreaterequal isless islessequal islessgreater isunordered
    drem finite scalb significand
"""
MATHEMATICS = frozenset(_MATHEMATICS.split())
"""Those of <math.h>, which have suffixes f and l too."""

_KINDS = (
    "run|rest|integral|roots|places|sum|mean|polygon|segment|hyperbola|ellipse|branch|decision|straight|crossed|alone|covered|steady|narrow"
    "|spans|runs|eight"
)
ROUTINES = re.compile(rf"element(_part_\d+)?|({_KINDS})_\d.*")
"""What the functions in the generated text are called, whether this one has them or not."""

_TYPES = (
    "blkcnt|blksize|caddr|clock|clockid|daddr|dev|div|double|float|fsblkcnt|fsfilcnt|fsid|gid|id|ino|key|ldiv|lldiv|locale|loff|mode|nlink"
    "|off|pid|pthread_[a-z]+|ptrdiff|quad|register|sigset|size|ssize|suseconds|time|timer|uid|u?int[a-z_]*[0-9]*|u_[a-z]+[0-9]*"
)
HEADERS = re.compile(rf"[A-Z][A-Z0-9]*_[A-Z0-9_]*|({_TYPES})_t")
"""What macros and types of headers are called: DBL_MAX, size_t."""


def check_function_name(name: str) -> None:
    """Raise OptionError if a C function cannot have the name."""
    usable = re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,50}", name)
    taken = name in WORDS or name in MATHEMATICS or (name[-1:] in ("f", "l") and name[:-1] in MATHEMATICS)
    taken |= ROUTINES.fullmatch(name) is not None or HEADERS.fullmatch(name) is not None
    if not usable or taken or name.lower().startswith("teg_"):
        hint = "letters, digits and _, no word, function, macro or type of C, not teg_…"
        raise OptionError("not usable as the name of a C function", name, hint)


def standalone_c(program: Program | ArrayProgram, name: str, outputs: Sequence[str] = (), real: str = "double") -> tuple[str, str]:
    """Returns the texts of `name`.c and `name`.h. `outputs` say what each output is, for the header; `real` is the C type of the numbers
    that go in and come out, "double" or "float" (of a program with arrays "double").

    Raises OptionError for a name that the function cannot have.
    """
    check_function_name(name)
    said = list(outputs) or [""] * len(program.outputs)
    assert len(said) == len(program.outputs)
    if isinstance(program, ArrayProgram):
        if real != "double":
            raise OptionError("a program with arrays is written with arrays of double only", real, "leave the dtype out")
        return print_arrays(program, name), _header(program, name, said, real)
    return print_kernel(program, name, real=real), _header(program, name, said, real)


def _header(program: Program | ArrayProgram, name: str, said: Sequence[str], real: str) -> str:
    arrays: Sequence[ArraySpec] = program.arrays if isinstance(program, ArrayProgram) else ()
    big = name.upper()
    inputs, outputs = _inputs(program), _outputs(program, said)
    listed = _described("inputs (parameters)", inputs) + _described("arrays", _arrays(arrays)) + _described("outputs", outputs)
    return f"""\
/* {name}.h - generated by teg.

{listed}\
   Characters of names other than letters and digits are given by their number, <U+03BB>; long names are cut.

{"" if arrays else _at_one_point(name, real)}\
   Compile with  cc -std=c99 -O2 -ffp-contract=off {name}.c ... -lm  (-O3 -march=native for speed; add -fopenmp for threads).
   With contraction to fused multiply-add, or -ffast-math, ties and NaN are not what they should be. */

#ifndef {big}_H
#define {big}_H

#include <stdint.h>

#define {big}_INPUTS {len(program.parameters)}
#define {big}_ARRAYS {len(arrays)}
#define {big}_OUTPUTS {len(program.outputs)}

#ifdef __cplusplus
extern "C" {{
#endif

{ABI}

{_functions(name, real)}
#ifdef __cplusplus
}}
#endif

#endif
"""


def _inputs(program: Program | ArrayProgram) -> list[str]:
    """Returns a line for each parameter."""
    counted = steps(program.body) if isinstance(program, ArrayProgram) else ()
    whole = {int(s.args[0]) for s in counted if isinstance(s, Integers) and s.op == "param"}
    return [f"p[{i}]  {harmless(p)}{', a whole number' * (i in whole)}" for i, p in enumerate(program.parameters)]


def _arrays(arrays: Sequence[ArraySpec]) -> list[str]:
    """Returns a line for each array."""
    lines = []
    for i, a in enumerate(arrays):
        axes = "1 dimension" if a.dimensions == 1 else f"{a.dimensions} dimensions"
        lines.append(f"a[{i}]  {harmless(a.name)}, {axes} of {'int64_t' if a.integers else 'double'}")
    return lines


def _outputs(program: Program | ArrayProgram, said: Sequence[str]) -> list[str]:
    """Returns a line for each output."""
    lines = []
    for j, (o, text) in enumerate(zip(program.outputs, said, strict=True)):
        like = f", an array of the shape of a[{o.array}]" if isinstance(o, Like) else ""
        lines.append(f"out[{j}]  {harmless(text, 100)}{like}".rstrip())
    return lines


def _described(what: str, lines: Sequence[str]) -> str:
    """Returns a paragraph of the header's comment, a line for each input, array or output."""
    rows = "\n".join("       " + line for line in lines or ["none"])
    return f"   {len(lines)} {what}, in order:\n\n{rows}\n\n"


def _functions(name: str, real: str) -> str:
    """Returns the declarations of both functions, and what their arguments are."""
    big = name.upper()
    return f"""\
/* n        how many elements the batch has; 0 does nothing.
   p        for each input where its values are: that of element k is p[i][k * stride[i]]. Inputs may overlap each other, not
            the outputs.
   stride   for each input how far apart the values of neighbouring elements are, in numbers; 0: all share one value.
   a        the arrays, {big}_ARRAYS of them (NULL if there are none). Subscripts are NOT checked: whatever the program reads
            must be inside of its array, and a sum must not end before it begins.
   out      for each output where it goes: output j of element k is out[j][k]; of one that is an array of size numbers it is the
            numbers from out[j] + k * size on, row by row. Outputs are set, not added to, and must not overlap inputs or arrays.
            NaN where an input is NaN, and where there is no answer.
   notes    NULL, or room for n: notes[k] is 4 if a condition has more roots than there is room for in element k (a larger
            max_roots= gives more), plus 2 if a tolerance was missed, plus 1 if surfaces coincide there (the output, or the terms
            of a sum in question, are then the mean of both sides).
   threads  compiled with OpenMP, so many share the batch, or the iterations of an outermost sum; the outputs have the same bits
            for any number.

   Returns 0; 1 if there was no memory for the workspace, and then the outputs are not complete. Nothing is kept between calls,
   and several threads may call at once. */
int {name}(
    long n, const {real} *const *p, const long *stride, const teg_array *a, {real} *const *out, long *notes, int threads);

/* The same, watched: `poll` (or NULL) is called with `data` now and then, by the calling thread only, and tells after how
   many more pieces of work (elements, iterations, or integrals inside of one) to call it again, such as 16; 0 stops, and then 2
   is returned and the outputs are not complete. */
int {name}_watched(
    long n, const {real} *const *p, const long *stride, const teg_array *a, {real} *const *out, long *notes, int threads,
    long (*poll)(void *data), void *data);
"""


def _at_one_point(name: str, real: str) -> str:
    """Returns an example of a call, at one point, of a function without arrays."""
    big = name.upper()
    return f"""\
   {name}(n, p, stride, NULL, out, notes, threads) evaluates the program at n points. At one point, from an array of the inputs:

       {real} values[{big}_INPUTS], results[{big}_OUTPUTS];
       const {real} *p[{big}_INPUTS];
       {real} *out[{big}_OUTPUTS];
       long stride[{big}_INPUTS];
       for (int i = 0; i < {big}_INPUTS; i++) p[i] = &values[i], stride[i] = 0;
       for (int j = 0; j < {big}_OUTPUTS; j++) out[j] = &results[j];
       if ({name}(1, p, stride, NULL, out, NULL, 1)) abort();

"""
