"""Faults that are known and open, as seeds of the quick run: the run passes over them and prints them."""

from __future__ import annotations

OPEN: dict[int, str] = {}
"""The seed, and the cause."""
