"""Builders of recursions: each is built once for its arguments, and its instructions are cached for later programs.

The result of a builder depends on its arguments and on the code of this package. Cached instructions are therefore
stored under a hash of both. They are not cached if an argument is a custom effect: its equations may change while the
code of this package does not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial, wraps
from pathlib import Path
from typing import Any, ParamSpec, Protocol, runtime_checkable

import casadi as ca

from plant.file_cache import content_hash
from plant.recursion import Recursion
from plant.symbolic import one_at_a_time

Arguments = ParamSpec("Arguments")
_MOST = 512  # recursions in memory for one builder
_BUILDERS = ("plant", "identification", "diagnosis")  # packages that contain builders


@runtime_checkable
class _HasEquations(Protocol):
    @property
    def equations(self) -> tuple[Any, ...]: ...


def recursion(carried: int) -> Callable[[Callable[Arguments, Any]], Callable[Arguments, Recursion]]:
    """Decorate a builder of a `casadi.Function` to return a `Recursion`, built once for each set of arguments.

    The first `carried` outputs of the function are its next first inputs. The arguments are hashable and must determine
    the result completely.
    """

    def of(build: Callable[Arguments, Any]) -> Callable[Arguments, Recursion]:
        @wraps(build)
        def made(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Recursion:
            building: Callable[[], Any] = partial(one_at_a_time(build), *args, **kwargs)
            return Recursion(building, carried, _folder(build, (*args, *sorted(kwargs.items()))))

        once: Callable[Arguments, Recursion] = one_at_a_time(lru_cache(maxsize=_MOST)(made))
        return once

    return of


def _folder(build: Callable[..., Any], args: tuple[Any, ...]) -> str | None:
    """Name of the cache folder for a builder and its arguments; None if the result must not be cached."""
    if build.__module__.partition(".")[0] not in _BUILDERS or not (code := _code()):
        return None
    texts = [_text(each) for each in args]
    if None in texts:
        return None
    parts = (ca.CasadiMeta.version(), code, build.__module__, build.__qualname__, *map(str, texts))
    return f"{build.__name__.strip('_')}-{content_hash(repr(parts).encode())}"


def _text(value: Any) -> str | None:
    """Text that identifies a value uniquely; None if it depends on code outside this package."""
    if isinstance(value, _HasEquations):
        return _text(value.equations)
    if isinstance(value, tuple):
        texts = [_text(each) for each in value]
        return None if None in texts else repr(texts)
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__}" if value.__module__.startswith("plant.") else None
    return repr(value) if value is None or isinstance(value, bool | int | float | str) else None


@lru_cache(maxsize=1)
def _code() -> str:
    """Hash of the code of all builders; empty if it cannot be read."""
    root = Path(__file__).parent.parent
    try:
        files = sorted(path for name in _BUILDERS for path in (root / name).rglob("*.py"))
        return content_hash(b"".join(path.read_bytes() for path in files))
    except OSError:
        return ""
