"""The state of a controller: pickled, transferred to another controller, reset."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mpc.bumpless_transfer import Running, hand_over
from plant.errors import BadParameter
from plant.result_display import Listed

Array = NDArray[np.float64]


class Remembering(Listed):
    """Base of `Controller`: attributes fixed after construction, and arrays with the changing state.

    Attributes:
        _arrays: all arrays that a step reads and writes, by name.
        _remembered: names of the arrays that hold the state, not constants.
        _left_out: names of the attributes that were chosen automatically.
        _step: the function of a step; it is set last.
    """

    _arrays: dict[str, Array]
    _remembered: tuple[str, ...]
    _left_out: tuple[str, ...]

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change a public attribute: all constants are computed from the attributes."""
        if "_step" in self.__dict__ and not name.startswith("_"):
            raise FrozenInstanceError(
                f"a Controller is fixed when it is made, so {name} cannot be set; controller.with_({name}=...) gives "
                "one that goes on from here."
            )
        super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        """Arguments of the constructor and all arrays; the machine code is loaded from the cache again."""
        return partial(type(self), **self._made), (), {name: array.copy() for name, array in self._arrays.items()}

    def __setstate__(self, remembered: dict[str, Array]) -> None:
        """Restore the arrays."""
        for name, array in remembered.items():
            self._arrays[name][:] = array

    def with_(self, **changes: Any) -> Self:
        """A controller with changed attributes that continues bumplessly: same estimate, same plan.

        Attributes that were not given are chosen again. If the model changes, the disturbance is chosen so that the
        acceleration of the load stays the same. The present controller does not change; continue with only one of both.

        Args:
            changes: attributes by name, such as `max_torque=0.2` or `model=better`.

        Raises:
            BadParameter: an unknown attribute, or an invalid value.
        """
        made = self._made
        if unknown := sorted(set(changes) - set(made)):
            raise BadParameter(f"A Controller has no {unknown[0]!r}; it has {', '.join(made)}.")
        new = type(self)(**{**made, **dict.fromkeys(self._left_out), **changes})
        hand_over(self._running, new._running)
        return new

    def reset(self) -> None:
        """Reset the state: the next measurement starts a new estimate, at rest."""
        for name in self._remembered:
            self._arrays[name][:] = 0.0

    @property
    def _made(self) -> dict[str, Any]:
        """The arguments of the constructor, by name."""
        itself: Any = self
        return {each.name: getattr(self, each.name) for each in fields(itself) if each.init}

    @property
    def _running(self) -> Running:
        """The parts that are transferred to another controller."""
        itself: Any = self
        return Running(
            model=itself.model,
            sample_time=itself.sample_time,
            late=itself._whole_delay,
            greatest=float(np.max(np.abs(itself.bounds.reachable()))),
            estimator=itself.estimator,
            arrays=self._arrays,
            remembered=self._remembered,
        )
