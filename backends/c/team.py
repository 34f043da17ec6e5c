"""Loops whose iterations a team of threads shares."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.text import indent


def shared(
    opening: Sequence[str], loop: Sequence[str], closing: Sequence[str] = (), share: str = "1", outer: str = "", worth: str = "team > 1"
) -> list[str]:
    """Returns the lines of a `loop` that is cut into parts of `share` iterations, for one thread if it is not `worth` a team. Each thread
    runs `opening` before, which declares its pace (`own`, if there is an `outer` one), and `closing` behind. `working` counts the threads,
    the thread of the call marks itself as the caller, and waits for the others."""
    pace, is_caller = ("pace", f"own.caller = {outer}->caller;") if outer else ("&pace", "pace.caller = 1;")
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
            is_caller,
            "#ifdef _OPENMP",
            f"#pragma omp for schedule(dynamic, {share}) nowait",
            "#endif",
            *loop,
            *closing,
            "#ifdef _OPENMP",
            f"teg_wait({pace}, &working);",
            "#endif",
        ),
        "}",
    ]
