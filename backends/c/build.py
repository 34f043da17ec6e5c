"""C text to a loaded shared library, through the cache on disk (see `cache`).

The compiler is run without a shell, in a folder of its own that holds its temporary files too.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import logging
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from teg.backends.c.cache import KEY_LENGTH, OBJECT, SUFFIX, ZIG, cache_folder, digest_of, stored, temporary_folder, trim
from teg.backends.c.threads import library_at
from teg.errors import CompilerError

log = logging.getLogger("teg.backends.c")
BASE_FLAGS = ("-std=c99", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
NATIVE = "-march=native"
MACHINE: tuple[str, ...] = (NATIVE,)
"""Which processors a library is for. The key of the cache holds this machine's."""
OPENMP = "-fopenmp"
LIGHT = (
    "-fno-tree-dominator-opts",
    "-fno-tree-dse",
    "-fno-tree-fre",
    "-fno-forward-propagate",
    "-fno-dse",
    "-fno-cprop-registers",
    "-fno-inline-functions-called-once",
    "-fira-algorithm=priority",
)
"""With -O1: passes that take a third of the time of long straight-line texts, and make them 3 % faster."""
OPTIMISE = ("-O3",)
UNKNOWN_TO_ZIG = (OPENMP, *LIGHT)
"""Flags that zig's clang refuses, or accepts and then makes a library that cannot be loaded, for lack of a runtime for threads."""
NO_COMPILER = (
    'pip install "teg-compiler[c]" brings one; or install one (Debian, Ubuntu: apt install gcc; macOS: xcode-select --install; Windows: '
    'gcc of MSYS2), or name one in the environment variable CC; backend="numpy" works without a compiler'
)


def load_library(text: str, *, optimise: Sequence[str] = ("-O3",), openmp: bool = False) -> ctypes.CDLL:
    """Returns the library of `text`, from the cache if it is there; one that cannot be loaded is rebuilt, the second time outside of the
    cache."""
    compiler = find_compiler()
    flags = (*optimise, *BASE_FLAGS, *MACHINE, *((OPENMP,) if openmp else ()))
    key = _key(text, compiler, flags)
    folder = cache_folder() / key
    trouble: OSError | None = None
    for place in (folder, folder, temporary_folder(os.getpid()) / key):
        path = _kept_or_stored(place, text, compiler, flags, SUFFIX)
        try:
            return library_at(path)
        except OSError as error:
            trouble = error
            path.unlink(missing_ok=True)
    raise CompilerError("the compiled kernel cannot be loaded", shlex.join(compiler), str(trouble))


def load_linked(kernel: str, functions: Sequence[str], binding: str, *, optimise: Sequence[str], openmp: bool = False) -> ctypes.CDLL:
    """Returns the library of a kernel, functions that it calls and the text that binds them, each compiled only if it is not in
    the cache."""
    compiler = find_compiler()
    more = (OPENMP,) if openmp else ()
    objects = [str(_object(kernel, compiler, (*optimise, *BASE_FLAGS, *MACHINE, *more)))]
    objects += [str(_object(text, compiler, (*OPTIMISE, *BASE_FLAGS, *MACHINE))) for text in functions]
    return load_library(binding, optimise=(*OPTIMISE, *objects), openmp=openmp)


def _object(text: str, compiler: tuple[str, ...], flags: tuple[str, ...]) -> Path:
    """Returns the object file of a text that is to be linked with others."""
    flags = tuple("-c" if flag == "-shared" else flag for flag in flags)
    folder = cache_folder() / _key(text, compiler, flags)
    return _kept_or_stored(folder, text, compiler, flags, OBJECT)


def _kept_or_stored(folder: Path, text: str, compiler: tuple[str, ...], flags: tuple[str, ...], suffix: str) -> Path:
    """Returns the file of a text in a folder of the cache, compiled if it is not there."""
    path = stored(folder, suffix)
    if path is not None:
        log.debug("found in the cache: %s", path)
        return path
    start = time.perf_counter()
    path = _store(folder, text, compiler, flags, suffix)
    log.debug("compiled by %s in %.3g s: %s", compiler[0], time.perf_counter() - start, path)
    return path


def find_compiler() -> tuple[str, ...]:
    """Returns the C compiler's command: `CC`, which may hold arguments, else the first of cc, gcc, clang, else the one of the package
    ziglang."""
    chosen = os.environ.get("CC", "")
    try:
        candidates = [shlex.split(chosen), ["cc"], ["gcc"], ["clang"]]
    except ValueError as error:
        message = f"the environment variable CC is no command: {str(error).lower()}"
        raise CompilerError(message, repr(chosen), 'write it as in a shell, CC="gcc -m64"') from None
    for command in filter(None, candidates):
        path = shutil.which(command[0])
        if path is not None:
            return (os.path.abspath(path), *command[1:])
    if from_wheel := zig_of_wheel():
        return from_wheel
    raise CompilerError("no C compiler was found", hint=NO_COMPILER)


def zig_of_wheel() -> tuple[str, ...]:
    """Returns the command of the C compiler in the Python package ziglang; empty if the package is not installed."""
    package = importlib.util.find_spec("ziglang")
    for folder in (package.submodule_search_locations or ()) if package else ():
        path = os.path.abspath(os.path.join(folder, "zig.exe" if os.name == "nt" else "zig"))
        if os.access(path, os.X_OK):
            return (path, "cc")
    return ()


def _flags_for(compiler: tuple[str, ...], flags: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the flags that a compiler is to be tried with. Zig's traps undefined behaviour unless it is told not to."""
    if not (Path(compiler[0]).stem == "zig" and "cc" in compiler[1:2]):
        return flags
    return (*(flag for flag in flags if flag not in UNKNOWN_TO_ZIG), "-fno-sanitize=undefined")


def compile_library(text: str, target: Path, compiler: tuple[str, ...], flags: tuple[str, ...]) -> None:
    """Compile `text` into `target`, without flags that the compiler does not know.

    Raises OSError if there is no room for the result, or its folder was removed meanwhile.
    """
    source = target.with_suffix(".c")
    source.write_text(text, encoding="ascii")
    without: list[tuple[str, ...]] = [(), (NATIVE,), (OPENMP,), (NATIVE, OPENMP), LIGHT, (NATIVE, OPENMP, *LIGHT)]
    environment = {**_environment(), **dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(target.parent))}
    messages, flags = [], _flags_for(compiler, flags)
    for attempt in dict.fromkeys(tuple(flag for flag in flags if flag not in left_out) for left_out in without):
        command = [*compiler, *attempt, "-o", target.name, source.name, "-lm"]
        try:
            done = subprocess.run(command, cwd=target.parent, env=environment, stdin=subprocess.DEVNULL, capture_output=True)
        except OSError as error:
            if not target.parent.is_dir():  # the cache was cleared meanwhile
                raise
            raise CompilerError("the C compiler cannot be run", shlex.join(command), str(error)) from error
        if done.returncode == 0 and target.exists():
            return
        _check_room(target.parent)
        messages.append(done.stderr.decode(errors="replace").strip() or f"exit status {done.returncode}")
    raise CompilerError("the C compiler rejected the generated text", shlex.join(command), messages[0][:4000])


def _environment() -> dict[str, str]:
    """Returns the environment of the compiler. Zig never ends where it cannot write to the folder of its parts, so it gets one that is
    there."""
    return {"ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / ZIG), **os.environ}


def _check_room(folder: Path) -> None:
    """Raise OSError if there is no room for a file of the size of a library."""
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(bytes(2**20))
        file.flush()


def _key(text: str, compiler: tuple[str, ...], flags: tuple[str, ...]) -> str:
    parts = (text, *compiler, _version(compiler), *flags, _processor())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:KEY_LENGTH]


@lru_cache(maxsize=8)
def _version(compiler: tuple[str, ...]) -> str:
    try:
        done = subprocess.run([*compiler, "--version"], env=_environment(), stdin=subprocess.DEVNULL, capture_output=True)
    except OSError as error:
        raise CompilerError("the C compiler cannot be run", shlex.join(compiler), str(error)) from error
    return done.stdout.decode(errors="replace")


@lru_cache(maxsize=1)
def _processor() -> str:
    """Returns a text that changes with the meaning of `-march=native`, because machines with different processors may share a
    home folder."""
    name = f"{platform.system()} {platform.machine()} {platform.processor()}"
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            first = file.read().split("\n\n", 1)[0].splitlines()
    except OSError:
        return name
    return "\n".join([name, *(line for line in first if line.startswith(("model name", "flags", "Features", "CPU part")))])


def _store(folder: Path, text: str, compiler: tuple[str, ...], flags: tuple[str, ...], suffix: str = SUFFIX) -> Path:
    """Build in a separate folder, rename into the cache; if that fails (a full disk, a cache that is cleared) keep a private copy."""
    try:
        return _store_under(folder, text, compiler, flags, suffix)
    except OSError:
        return _store_under(temporary_folder(os.getpid()) / folder.name, text, compiler, flags, suffix)


def _store_under(folder: Path, text: str, compiler: tuple[str, ...], flags: tuple[str, ...], suffix: str) -> Path:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="build-", dir=folder, ignore_cleanup_errors=True) as workshop:
        library = Path(workshop, "kernel" + suffix)
        compile_library(text, library, compiler, flags)
        path = folder / (digest_of(library) + suffix)
        try:
            os.replace(library, path)
        except PermissionError:  # Windows: another process has the same library open
            if not path.exists():
                raise
    trim(folder.parent)
    return path
