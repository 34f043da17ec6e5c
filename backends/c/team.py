"""Loops whose iterations a team of threads shares."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.text import indent


def shared(
    opening: Sequence[str],
    loop: Sequence[str],
    closing: Sequence[str] = (),
    share: str = "1",
    nested: bool = False,
    worth: str = "team > 1",
) -> list[str]:
    """Returns the lines of a `loop` that is cut into parts of `share` iterations. Threads share it where the C condition `worth` holds.

    Each runs `opening` before, which declares its pace, and `closing` behind. Where a loop is `nested` in another one with a pace,
    `opening` names that pace `outer` and the thread's `own`. `working` counts the threads; the thread of the call marks itself as the
    caller, and waits for the others.
    """
    pace, is_caller = ("pace", "own.caller = outer->caller;") if nested else ("&pace", "pace.caller = 1;")
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
