"""Loops whose iterations a team of threads shares."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.text import indent


def shared(
    opening: Sequence[str],
    loop: Sequence[str],
    closing: Sequence[str] = (),
    caller: str = "pace.caller = 1;",
    own: str = "&pace",
    share: str = "1",
    worth: str = "team > 1",
) -> list[str]:
    """Returns the lines of a `loop` that is cut into parts of `share` iterations, for one thread unless it is `worth` a team. Each thread
    runs `opening` before, which declares its pace, `own`, and `closing` behind. `working` counts the threads, the thread of the call marks
    itself as the `caller`, and waits for the others."""
    return [
        "#ifdef _OPENMP",
        f"#pragma omp parallel num_threads(team) if ({worth})",
        "#endif",
        "{",
        *indent(
            *opening,
            "#ifdef _OPENMP",
            "#pragma omp atomic",
            "working++;",
            "#pragma omp barrier",
            "#pragma omp master",
            "#endif",
            caller,
            "#ifdef _OPENMP",
            f"#pragma omp for schedule(dynamic, {share}) nowait",
            "#endif",
            *loop,
            *closing,
            "#ifdef _OPENMP",
            f"teg_wait({own}, &working);",
            "#endif",
        ),
        "}",
    ]
