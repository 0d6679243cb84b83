"""What the reference will be: beyond a single number, and beyond the horizon."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(eq=False, kw_only=True)
class Preview:
    """The wanted angle over the horizon, also from a caller who only tells the angle of now.

    Attributes:
        horizon: N, samples looked ahead.
        attainable: largest change of the way from sample to sample that the machine could follow [rad].
    """

    horizon: int
    attainable: float
    _numbers: deque[float] = field(default_factory=lambda: deque(maxlen=3), init=False, repr=False)

    def over(self, wanted: Array) -> Array:
        """The wanted angle (N + 1,) [rad]; a single number goes on at its speed if it has been moving smoothly."""
        if wanted.ndim == 1:
            self._numbers.clear()
            return wanted
        self._numbers.append(float(wanted))
        speed = 0.0
        if len(self._numbers) == 3:
            first, second, third = self._numbers
            if abs(third - 2.0 * second + first) <= self.attainable:
                speed = third - second
        return np.asarray(wanted + speed * np.arange(self.horizon + 1))


def prolonged(path: Array, count: int) -> Array:
    """A path (M,), at least three samples, with `count` more: it goes on at its last acceleration.

    At its last speed alone it would fall behind a reference that bends, and drag the end of the plan with it.
    """
    speed = path[-1] - path[-2]
    bend = speed - (path[-2] - path[-3])
    k = np.arange(1, count + 1)
    return np.append(path, path[-1] + speed * k + bend * k * (k + 1) / 2)
