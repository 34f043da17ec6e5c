"""The cache of compiled C on disk.

    <cache>/<key>/<digest>.so      key: of text, compiler, its version, flags, CPU;   digest: of the library

The digest in the name makes an entry one file: written elsewhere, renamed into place, and checked before it
is loaded (loading a truncated library can end the process). Concurrent processes may build the same entry
twice; each renames a whole library.

The cache is `TEG_CACHE_DIR`, else where the system keeps caches of the user (Linux: `$XDG_CACHE_HOME/teg` or
`~/.cache/teg`, macOS: `~/Library/Caches/teg`, Windows: `%LOCALAPPDATA%\\teg\\Cache`), of mode 0700. A folder that
cannot be written, that others could write, that is full, or from which no library may be loaded (noexec), is
not used: a private temporary folder, removed at exit, replaces it.

Its entries take at most `TEG_CACHE_SIZE` megabytes (512): after a build those used longest ago are removed. An entry's time of modification
is that of its last use.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from teg.errors import OptionError

SUFFIX = ".dll" if sys.platform == "win32" else ".so"
OBJECT = ".o"
MEGABYTE = 10**6
MEGABYTES = 512.0
"""What entries may take in all, if `TEG_CACHE_SIZE` says nothing else."""
RECENT = 600
"""Seconds in which what was used may be in use: another process may be about to load it, or to link it."""
KEY_LENGTH = 40
ABANDONED = 24 * 3600
"""Seconds after which a build is over: its process was killed."""
PAUSE = 60.0
"""The least seconds between two looks at all entries."""
TRIMMED = "trimmed"
"""A file that is as old as the last look at all entries."""
ZIG = "zig"
"""A folder in which zig keeps its own parts, some 50 MB, if it is the compiler; no entry of ours."""


PROGRAMS = "jax"
"""A folder in which JAX keeps its programs (`teg.jax_cache`); no entry of ours."""


def cache_folder() -> Path:
    """Returns the folder of the cache, made if it is missing, or a private temporary one if it cannot be used."""
    try:
        folder = Path(os.environ.get("TEG_CACHE_DIR") or _user_cache()).absolute()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_private(folder) and os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        pass
    return temporary_folder(os.getpid())


def _user_cache() -> Path:
    """Returns the folder in which the system keeps what programs can compute again. Raises RuntimeError if there is no home."""
    if os.environ.get("HOME") == "" and not os.path.isabs(os.environ.get("XDG_CACHE_HOME", "")):
        raise RuntimeError("HOME is empty")  # which Python takes for the root folder
    from platformdirs import user_cache_path

    folder = user_cache_path("teg", appauthor=False)
    return folder if folder.is_absolute() else Path.home() / ".cache" / "teg"


def _is_private(folder: Path) -> bool:
    """Returns whether only this user can put a library there."""
    if sys.platform == "win32":
        return True
    status = folder.stat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


@lru_cache(maxsize=1)
def temporary_folder(process: int) -> Path:
    """Returns a private folder of this process (a forked child makes its own), removed at exit."""
    folder = Path(tempfile.mkdtemp(prefix="teg-"))

    def remove() -> None:
        if os.getpid() == process:
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder


def stored(folder: Path, suffix: str = SUFFIX) -> Path | None:
    """Returns the entry of a key, if there is one and it is whole; damaged ones are removed."""
    try:
        entries = sorted(folder.glob("*" + suffix))
    except OSError:
        return None
    for path in entries:
        try:
            if digest_of(path) == path.stem:
                with suppress(OSError):  # it is not ours
                    os.utime(path)
                return path
            path.unlink()
        except OSError:
            continue
    return None


class Entry(NamedTuple):
    """A library or an object file: its size in bytes, and when it was used last."""

    path: Path
    size: int
    used: float


def entries_of(cache: Path) -> list[Entry]:
    """Returns all entries, the one used longest ago first."""
    entries = []
    for key in _keys(cache):
        for path in key.glob("*.*"):
            if path.suffix in (SUFFIX, OBJECT):
                with suppress(OSError):  # it was removed meanwhile
                    status = path.stat()
                    entries.append(Entry(path, status.st_size, status.st_mtime))
    return sorted(entries, key=lambda entry: entry.used)


def trim(cache: Path) -> None:
    """Removes files of killed processes, and entries until the cache is within its limit, except those that may be in use.

    Nothing is done within `PAUSE` seconds of the last time.
    """
    now, last = time.time(), cache / TRIMMED
    with suppress(OSError):  # nothing was trimmed before
        if 0.0 <= now - last.stat().st_mtime < PAUSE:
            return
    with suppress(OSError):
        last.touch(mode=0o600)
    for key in _keys(cache):
        for build in key.glob("build-*"):
            with suppress(OSError):
                if now - build.stat().st_mtime > ABANDONED:
                    shutil.rmtree(build, ignore_errors=True)
    entries = entries_of(cache)
    excess = sum(entry.size for entry in entries) - size_limit()
    for entry in entries:
        if excess <= 0 or now - entry.used < RECENT:
            return
        with suppress(OSError):
            entry.path.unlink()
            excess -= entry.size
            entry.path.parent.rmdir()  # which fails if there is another entry


def clear(cache: Path) -> list[Entry]:
    """Remove all entries; what they were."""
    entries = entries_of(cache)
    for key in [*_keys(cache), cache / ZIG, cache / PROGRAMS]:
        shutil.rmtree(key, ignore_errors=True)
    with suppress(OSError):
        (cache / TRIMMED).unlink()
    return [entry for entry in entries if not entry.path.exists()]


def size_limit() -> float:
    """Returns the bytes that all entries may take. Raises OptionError if `TEG_CACHE_SIZE` is no number of megabytes."""
    chosen = os.environ.get("TEG_CACHE_SIZE") or str(MEGABYTES)
    try:
        megabytes = float(chosen)
    except ValueError:
        megabytes = -1.0
    if not megabytes >= 0.0:
        raise OptionError("the environment variable TEG_CACHE_SIZE is no size", repr(chosen), "a number of megabytes: TEG_CACHE_SIZE=512")
    return megabytes * MEGABYTE


def _keys(cache: Path) -> Iterator[Path]:
    """Yields the folders of the cache, and nothing else that may be beside them."""
    for path in cache.iterdir() if cache.is_dir() else ():
        if len(path.name) == KEY_LENGTH and not set(path.name) - set("0123456789abcdef") and path.is_dir():
            yield path


def digest_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:KEY_LENGTH]
