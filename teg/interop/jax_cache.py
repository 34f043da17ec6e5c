"""`teg.jax_cache`: programs that XLA has compiled are kept on disk."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from teg.errors import MissingPackageError


def jax_cache(folder: str | os.PathLike[str] | None = None, *, seconds: float = 0.5) -> Path:
    """Returns the folder on disk where the programs that JAX compiles are kept from now on, for this process and those after it.

        folder = teg.jax_cache()                  # once, at the beginning of a script: its next run loads what this one compiles

    This is JAX's persistent compilation cache, for all programs of the process. `folder` is where programs are kept: by default the one
    that is set already (`JAX_COMPILATION_CACHE_DIR`), else `jax` in the cache of compiled C, which `teg cache clear` empties. Programs that
    take less than so many `seconds` to compile are not kept. Tracing, which is about as long, is not saved.

    A program is found again if it, the version of JAX and the device are the same. Raises MissingPackageError without JAX.
    """
    try:
        import jax
        from jax.experimental.compilation_cache import compilation_cache
    except ImportError:
        raise MissingPackageError("the package jax is not installed", None, 'pip install "teg-compiler[jax]"') from None
    from teg.backends.c.cache import PROGRAMS, cache_folder

    config: Any = jax.config
    chosen = folder or config.jax_compilation_cache_dir or cache_folder() / PROGRAMS
    path = Path(chosen).expanduser().absolute()
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    config.update("jax_compilation_cache_dir", str(path))
    config.update("jax_persistent_cache_min_compile_time_secs", seconds)
    compilation_cache.reset_cache()  # JAX looks at the folder once, when it first compiles
    return path
