"""Programs written by hand, with exact values: every backend runs over this table."""

from __future__ import annotations

from tests.backends.adaptive_programs import ADAPTIVE, WATCHED
from tests.backends.case import INF, NAN, TIGHT, Case, Row, columns, expected, integrate, let, operation, program
from tests.backends.integral_programs import DISC, ONE_VARIABLE, TWO_VARIABLES
from tests.backends.operation_programs import OPERATIONS
from tests.backends.tie_programs import TIES

__all__ = [
    "ADAPTIVE", "CASES", "DISC", "INF", "NAN", "ONE_VARIABLE", "OPERATIONS", "TIES", "TIGHT", "TWO_VARIABLES", "WATCHED", "Case", "Row",
    "columns", "expected", "integrate", "let", "operation", "program",
]  # fmt: skip

CASES = (*OPERATIONS, *ONE_VARIABLE, *TWO_VARIABLES, *ADAPTIVE, *WATCHED, *TIES)
