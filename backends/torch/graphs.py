# mypy: disallow-untyped-decorators=False
"""A call that `torch.compile` leaves to Python, between two graphs. A module of its own, for this imports PyTorch's compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch


@torch.compiler.disable
def outside_of_graphs(call: Callable[..., Any], *arguments: Any) -> Any:
    """Returns the result of a call that is in no graph."""
    return call(*arguments)
