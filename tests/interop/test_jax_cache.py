"""`teg.jax_cache`: a second process finds what the first one compiled."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import teg
from teg.errors import MissingPackageError

jax = pytest.importorskip("jax")

PROGRAM = """
import jax, teg
x, (t, a) = teg.var("x"), teg.params("t a")
f = teg.jax_function(teg.integral(teg.bracket(x < t) * (1 + a * x), (x, 0, 1)), kernel="xla")
jax.jit(lambda v: v + 1)(1.0)  # JAX has compiled before
print(teg.jax_cache(seconds=0.0))
events = []
jax.monitoring.register_event_listener(lambda event, **_: events.append(event))
p = {"t": 0.5, "a": 1.0}
jax.jit(jax.value_and_grad(f)).lower(p).compile()
print(events.count("/jax/compilation_cache/cache_hits"), events.count("/jax/compilation_cache/cache_misses"))
"""


def test_a_second_process_finds_it(tmp_path: Path) -> None:
    found = []
    for _ in range(2):
        environment = {**os.environ, "TEG_CACHE_DIR": str(tmp_path), "JAX_PLATFORMS": "cpu"}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        run = subprocess.run([sys.executable, "-c", PROGRAM], check=True, env=environment, capture_output=True, text=True)
        folder, counts = run.stdout.splitlines()
        assert Path(folder) == tmp_path / "jax"
        found.append(counts)
    assert found == ["0 1", "1 0"]
    from teg.backends.c.cache import clear

    clear(tmp_path)
    assert not (tmp_path / "jax").exists()


def test_a_missing_jax_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingPackageError) as caught:
        teg.jax_cache()
    assert caught.value.hint == 'pip install "teg-compiler[jax]"'
