"""The cache of compiled C on disk.

    <cache>/<key>/<digest>.so      key: of text, compiler, its version, flags, CPU;   digest: of the library

The digest in the name makes an entry one file: written elsewhere, renamed into place, and checked before it
is loaded (loading a truncated library can end the process). Concurrent processes may build the same entry
twice; each renames a whole library.

The cache is `TEG_CACHE_DIR`, else `$XDG_CACHE_HOME/teg`, else `~/.cache/teg`, of mode 0700. A folder that
cannot be written, that others could write, that is full, or from which no library may be loaded (noexec), is
not used: a private temporary folder, removed at exit, replaces it.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
import time
from functools import lru_cache
from pathlib import Path

SUFFIX = ".dll" if sys.platform == "win32" else ".so"
ABANDONED = 24 * 3600
"""Seconds after which a build is over: its process was killed."""


def cache_folder() -> Path:
    """The folder of the cache, made if it is missing, or a private temporary one if it cannot be used."""
    try:
        folder = Path(os.environ.get("TEG_CACHE_DIR") or Path(_user_cache(), "teg")).absolute()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_private(folder) and os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        pass
    return temporary_folder(os.getpid())


def _user_cache() -> Path:
    configured = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(configured) and os.environ.get("HOME") == "":
        raise RuntimeError("HOME is empty")  # which Python takes for the root folder
    return Path(configured) if os.path.isabs(configured) else Path.home() / ".cache"


def _is_private(folder: Path) -> bool:
    """Whether nobody but this user can put a library there."""
    if sys.platform == "win32":
        return True
    status = folder.stat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


@lru_cache(maxsize=1)
def temporary_folder(process: int) -> Path:
    """A private folder of this process (a forked child makes its own), removed at exit."""
    folder = Path(tempfile.mkdtemp(prefix="teg-"))

    def remove() -> None:
        if os.getpid() == process:
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder


def stored(folder: Path, suffix: str = SUFFIX) -> Path | None:
    """The entry of a key, if there is one and it is whole; damaged ones are removed."""
    try:
        entries = sorted(folder.glob("*" + suffix))
    except OSError:
        return None
    for path in entries:
        try:
            if digest_of(path) == path.stem:
                return path
            path.unlink()
        except OSError:
            continue
    return None


def remove_abandoned(folder: Path) -> None:
    """Remove what killed processes left."""
    for left in folder.glob("build-*"):
        try:
            old = time.time() - left.stat().st_mtime > ABANDONED
        except OSError:  # it was removed meanwhile
            continue
        if old:
            shutil.rmtree(left, ignore_errors=True)


def digest_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:40]
