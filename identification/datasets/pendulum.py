"""Position servos that move a pendulum: set-point as input, angle as output, the firmware's control law in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.datasets.dataset import recording
from identification.recording import Array, Recording

HANGING = -0.5 * np.pi  # eq. (4) has gravity alpha cos x, so the pendulum hangs at -pi/2
ENDS_WHEN_OFF = (
    "A run ends where the drive switches off: an open motor brakes by no back-EMF, so the load swings with another "
    "viscous friction than before, which no effect of the present catalogue can express."
)
VOLTS_UNKNOWN_SCALE = (
    "The torque's scale is unknown: torques are in volts at the motor, so J, alpha and K are per volt, and the "
    "viscous friction holds the back-EMF besides, which one supply voltage cannot tell apart."
)


def pendulum_run(
    *,
    label: str,
    number: int,
    time: Array,
    setpoint: Array,
    position: Array,
    duty_per_rad: float,
    volts: Array,
    enabled: NDArray[np.bool_],
) -> Recording:
    """One run of a position servo: motor voltage = volts * clip(duty_per_rad * (setpoint - angle), -1, 1), if enabled.

    Samples with a bus drop-out (supply voltage below 0.5 or above 1.5 times the median of the run) are masked. The run
    ends where the drive is switched off: without the braking by back-EMF the viscous friction would be another one.
    """
    supply = float(np.median(volts[volts > 1.0])) if np.any(volts > 1.0) else 1.0
    gain = np.where(enabled, duty_per_rad * supply, 0.0)
    dropped = (volts < 0.5 * supply) | (volts > 1.5 * supply)
    first = int(np.argmax(~dropped))
    off = np.flatnonzero(~enabled)
    used = slice(first, int(off[0]) if off.size else None)
    return recording(
        label=label,
        number=number,
        time=time[used] - time[first],
        command=(gain * (setpoint + HANGING))[used],
        output=(position + HANGING)[used],
        servo_gain=gain[used],
        command_limit=supply,
        valid=~dropped[used],
        setpoint=(setpoint + HANGING)[used],
    )
