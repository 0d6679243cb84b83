"""Expressions are built by one thread at a time.

CasADi's reference counts are not atomic, and all expressions share common nodes such as 0 and 1: two threads that build
different expressions may, rarely, free a node twice. The built functions may be evaluated by many threads at once.
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
    """Let only one thread at a time run a function that builds expressions."""

    @wraps(build)
    def alone(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with _building:
            return build(*args, **kwargs)

    return alone
