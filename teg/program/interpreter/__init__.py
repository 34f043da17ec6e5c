"""The executable meaning of programs: one point, plain Python numbers, nothing clever.

`interpret` runs a flat program and `interpret_arrays` one with arrays. The printers of the backends are tested against them: their results
agree up to the order in which numbers are added. A statement has one function here, which is its meaning.
"""

from __future__ import annotations

from teg.program.interpreter.arrays import InterpretedArrays, interpret_arrays
from teg.program.interpreter.machine import Interpreted, interpret

__all__ = ["Interpreted", "InterpretedArrays", "interpret", "interpret_arrays"]
