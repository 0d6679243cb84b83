"""Expressions are built by one thread at a time.

CasADi counts who holds a node without atomics, and all expressions share the nodes that are common, such as 0 and 1:
two threads that build different expressions free one twice, once in many thousand times. What is built may be evaluated
by many at once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_building = threading.RLock()


def one_at_a_time(build: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """What builds expressions, so that no other thread builds any meanwhile."""

    @wraps(build)
    def alone(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with _building:
            return build(*args, **kwargs)

    return alone
