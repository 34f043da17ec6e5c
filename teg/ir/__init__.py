"""Expressions. `expr` is imported first: its operators, and the functions that they call, need each other."""

from teg.ir import expr as expr
