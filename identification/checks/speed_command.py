"""A speed, or its set-point, that was taken for the torque.

A torque has to accelerate the load, and to overcome friction before it moves at all. A command that is proportional to
the speed does neither. If the factor is that of a unit of speed, also the set-point of a loop with a tracking error is
recognised. With another factor, the speed itself may have been taken: then no inertia is significant, whereas the
torque of a slow load with much viscous friction leads the speed because of its inertia. But a load with viscous
friction alone moves in the same way. So this gives a warning only, and so does any command for which the unit of a
torque was given.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.checks.filtered_motion import SURE, over_runs, views
from identification.recording import Finding, Recording

_UNITS = {
    "rotary": {"rad/s": 1.0, "rpm": 30 / np.pi, "deg/s": 180 / np.pi, "turn/s": 0.5 / np.pi, "mrad/s": 1e3},
    "linear": {"m/s": 1.0, "mm/s": 1e3, "mm/min": 6e4},
}
_EXACT, _FOLLOWED = 1e-3, 0.03  # most residual share of the command's sum of squares after regression on the speed
_NEAR = 0.01  # relative tolerance of the factor of a unit
_VARIES = 0.1  # least share of the variance in the mean square of the speed


def speed_for_torque(recording: Recording) -> Iterable[Finding]:
    """A command that is a speed in some unit makes the log unusable; one proportional to it gives a warning."""
    if recording.servo_gain.any():
        return
    part, seen = views(recording)
    for view in seen:
        speed, command = view.speed, view.behind(part.command)
        squares = float(speed @ speed), float(command @ command)
        if not min(squares) > 0 or speed.var() < _VARIES * squares[0] / len(speed):
            continue
        factor = float(speed @ command) / squares[0]
        left = 1.0 - factor**2 * squares[0] / squares[1]
        units = _UNITS[recording.axis].items()
        unit = next((unit for unit, size in units if abs(abs(factor) / size - 1) < _NEAR), None)
        taken = left < _EXACT and over_runs([view.inertia(part.command)]) < SURE if unit is None else left < _FOLLOWED
        if taken:
            name = recording.name("command")
            possible = "command" in recording.stated or unit is None
            what = f"the speed of '{recording.name('output')}'" + (f" in {unit}" if unit else f" times {factor:.4g}")
            statement = (
                "so the load has neither inertia nor dry friction, or a speed was taken for the torque"
                if possible
                else "so a speed or its set-point was taken for what drives the load; name the torque, current or "
                "voltage with --map torque=COLUMN"
            )
            text = f"{recording.label}: '{name}' is {what}, {statement}"
            yield Finding(kind="speed as command", repaired=False, text=text, unusable=not possible)
            return
