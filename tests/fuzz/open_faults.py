"""Faults that are known and open, as seeds of the quick run: the run passes over them and prints them."""

from __future__ import annotations

PEAK = "a narrow peak lies between all nodes of the first look"
FAR_END = "two surfaces that approach each other tie at their far end, for the whole gradient"

OPEN: dict[int, str] = {
    7: "a graph and a hyperbola: the gradient is not a number, and no warning says so",
    41: PEAK,
    91: "a cardioid: the value is not a number, and no warning says so",
    114: PEAK,
    159: PEAK,
    179: "y < t·x in other words: the gradient is not a number, and no warning says so",
    190: "a tiny literal",
    194: "a term of a sum that is compared with itself",
    210: PEAK,
    226: PEAK,
    238: FAR_END,
    251: PEAK,
    265: "a term of a sum that is compared with itself",
    268: "a graph that touches a side in a corner: the gradient is not a number, and no warning says so",
    271: FAR_END,
}
"""The seed, and the cause."""
