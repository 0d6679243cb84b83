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
    """A dataclass of numbers that is fixed once it is made, and arrays that go on changing.

    Attributes:
        _arrays: everything that a step reads and writes, by name.
        _remembered: of them what says what happened, not what was made.
        _left_out: numbers that were not given but chosen.
        _step: what makes a step, the last that is set.
    """

    _arrays: dict[str, Array]
    _remembered: tuple[str, ...]
    _left_out: tuple[str, ...]

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse a change: everything follows from the attributes, so none may change alone."""
        if "_step" in self.__dict__ and not name.startswith("_"):
            raise FrozenInstanceError(
                f"a Controller is fixed when it is made, so {name} cannot be set; controller.with_({name}=...) gives "
                "one that goes on from here."
            )
        super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        """How it was made, and what it remembers; the machine code is found again."""
        return partial(type(self), **self._made), (), {name: array.copy() for name, array in self._arrays.items()}

    def __setstate__(self, remembered: dict[str, Array]) -> None:
        """Go on from there."""
        for name, array in remembered.items():
            self._arrays[name][:] = array

    def with_(self, **changes: Any) -> Self:
        """A controller with some attributes changed that goes on from here: same estimate, same plan, no bump.

        What was left out is chosen anew. Where the model changes, the torque that nobody knows is chosen so that the
        load accelerates as before. This one is left as it is; let only one of both go on.

        Args:
            changes: attributes by name, such as `max_torque=0.2` or `model=better`.

        Raises:
            BadParameter: there is no such attribute, or a value that it cannot have.
        """
        made = self._made
        if unknown := sorted(set(changes) - set(made)):
            raise BadParameter(f"A Controller has no {unknown[0]!r}; it has {', '.join(made)}.")
        new = type(self)(**{**made, **dict.fromkeys(self._left_out), **changes})
        hand_over(self._running, new._running)
        return new

    def reset(self) -> None:
        """Forget everything: the next reading begins anew, at rest."""
        for name in self._remembered:
            self._arrays[name][:] = 0.0

    @property
    def _made(self) -> dict[str, Any]:
        """The attributes that it was made with."""
        itself: Any = self
        return {each.name: getattr(self, each.name) for each in fields(itself) if each.init}

    @property
    def _running(self) -> Running:
        """What of it goes on in another."""
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
