"""Parameters that differ from run to run: a payload, or parameters that were fitted for each run separately.

`Run.own` holds the differences from the parameters of the model. A payload changes the load alone: the motor, the
spring and the damper of a drivetrain are unchanged.
"""

from __future__ import annotations

import numpy as np

from identification.errors import MalformedLog
from identification.recording import Recording
from identification.run import Run
from plant.effects.effect import Array
from plant.servo import ServoModel

GRAVITY = 9.80665  # [m/s^2]
PAYLOAD = ("payload_mass", "payload_radius", "payload_inertia", "payload_gravity")
_ASIDE = 1e-6  # relative step of the finite differences


def payload_of(recording: Recording) -> dict[str, float]:
    """The inertia and gravity that the payload of a run adds, from its columns.

    A point mass m at a radius r adds m r^2 and m g r; its arm is horizontal at angle zero. On a linear axis it adds m.
    A given inertia [kg m^2] or gravity torque [N m] is added to that.

    Raises `MalformedLog` if a payload changes within a run, or a mass on a rotary axis has no radius.
    """
    known = {name: _constant(recording, name) for name in PAYLOAD if name in recording.others}
    mass, radius = known.get("payload_mass", 0.0), known.get("payload_radius", 0.0)
    inertia, gravity = known.get("payload_inertia", 0.0), known.get("payload_gravity", 0.0)
    if recording.axis == "linear":
        inertia += mass
    elif "payload_mass" in known and "payload_radius" not in known:
        raise MalformedLog(
            f"{recording.label}: a payload_mass on a rotary axis needs its payload_radius [m]; give both columns, or "
            "payload_inertia and payload_gravity."
        )
    else:
        inertia, gravity = inertia + mass * radius**2, gravity + mass * GRAVITY * radius
    return {name: value for name, value in (("inertia", inertia), ("gravity", gravity)) if value}


def _constant(recording: Recording, name: str) -> float:
    values = recording.others[name]
    if np.ptp(values) > 1e-9 * np.max(np.abs(values)):
        raise MalformedLog(
            f"{recording.label}: '{recording.name(name)}' changes within a run, from {values.min():g} to "
            f"{values.max():g}; number the runs in a column 'run', each with a payload of its own."
        )
    return float(values[0])


def own_values(run: Run, model: ServoModel, values: Array) -> Array:
    """(P,) parameters that hold in a run, from those of the model (P,)."""
    if not run.own:
        return values
    found = values.copy()
    if model.drivetrain is not None and "inertia" in run.own:
        found = model.with_values(values).with_payload(inertia=run.own["inertia"], gravity=0.0).values
    else:
        found[0] += run.own.get("inertia", 0.0)
    for name, more in run.own.items():
        if name != "inertia" and name in model.names:
            found[model.names.index(name)] += more
    return found


def own_slopes(run: Run, model: ServoModel, values: Array, free: tuple[int, ...]) -> Array | None:
    """(F, F) derivative of a run's free parameters by those of the model; None where it is the identity."""
    if model.drivetrain is None or "inertia" not in run.own:
        return None
    rows = list(free)
    slopes = np.empty((len(rows), len(rows)))
    for column, place in enumerate(rows):
        step = _ASIDE * (abs(values[place]) or 1.0)
        above, below = values.copy(), values.copy()
        above[place], below[place] = above[place] + step, below[place] - step
        slopes[:, column] = (own_values(run, model, above) - own_values(run, model, below))[rows] / (2.0 * step)
    return slopes


def own_model(run: Run, model: ServoModel) -> ServoModel:
    """The model with the parameters of a run."""
    return model.with_values(own_values(run, model, model.values)) if run.own else model
