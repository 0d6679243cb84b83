"""The fine integration step of the rig: motors with rotors, a backlash between each rotor and one load.

All angles and torques here are referred to the load side. A rotor whose angle equals the load's is in the middle of its
backlash.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

import casadi as ca

from plant.symbolic import one_at_a_time

BLOCK: Final = 10
"""Fine steps that one call executes; the overhead of a call equals that of several steps."""

LOAD_PARAMETERS: Final = (
    "inertia",
    "gravity",
    "gravity_offset",
    "viscous_friction",
    "coulomb_friction",
    "breakaway_excess",
    "stribeck_velocity",
    "quadratic_drag",
    "cogging_amplitude",
    "cogging_order",
    "cogging_phase",
    "torque_offset",
    "flank_stiffness",
    "flank_damping",
    "mesh_friction",
    "current_lag",
)
"""Parameters of the machine; `current_lag` is the time constant of the current loops [s]."""

DRIVE_PARAMETERS: Final = (
    "direction",
    "rotor_inertia",
    "rotor_viscous",
    "rotor_coulomb",
    "half_backlash",
    "stall_torque",
    "emf_damping",
)
"""Parameters of each drive, referred to the load; `direction` is the required sign of its output torque."""

REQUIRED_DIRECTION: Final = (-1.0, 1.0)
"""Required signs of D1 and D2: D1 pulls backward (xi1 > 0), D2 forward (xi2 < 0)."""


def states(drives: int) -> int:
    """Size of a state: load angle and velocity; of each drive angle, velocity, minimum contact torque, motor torque."""
    return 2 + 4 * drives


def contact_torque(
    relative_angle: Any, relative_velocity: Any, *, half_backlash: Any, stiffness: Any, damping: Any
) -> Any:
    """Torque transmitted from a rotor to the load through the gear contact, referred to the load [N m].

    Dead zone, spring and damper, clipped to pushing (Nordin, Galic, Gutman 1997): no torque is transmitted within the
    backlash; on either flank a tooth can push but never pull, at any velocity.

    Args:
        relative_angle: rotor angle less load angle [rad], zero in the middle of the backlash.
        relative_velocity: its derivative [rad/s].
        half_backlash: half of the backlash [rad].
        stiffness: of a flank pair in contact [N m/rad].
        damping: of a flank pair in contact [N m s/rad].
    """
    forward = ca.fmax(0.0, stiffness * (relative_angle - half_backlash) + damping * relative_velocity)
    backward = ca.fmin(0.0, stiffness * (relative_angle + half_backlash) + damping * relative_velocity)
    return ca.if_else(
        relative_angle > half_backlash, forward, ca.if_else(relative_angle < -half_backlash, backward, 0.0)
    )


def motor_torque(before: Any, command: Any, velocity: Any, *, lag: Any, stall_torque: Any, emf_damping: Any) -> Any:
    """Torque of a motor with its current loop, within the limits of supply and winding [N m].

    The first-order loop approaches the command by the fraction 1 - lag in a step. The supply U requires |U| >= |R i + k
    w|, hence k i between -k U/R - k^2/R w and k U/R - k^2/R w.

    Args:
        before: torque one step ago [N m].
        command: commanded torque [N m].
        velocity: of the rotor [rad/s].
        lag: exp(-step times bandwidth); zero for an ideal loop.
        stall_torque: k U/R [N m]; infinite without a supply limit.
        emf_damping: k^2/R [N m s/rad].
    """
    followed = (1.0 - lag) * command + lag * before
    back = emf_damping * velocity
    return ca.fmax(-stall_torque - back, ca.fmin(stall_torque - back, followed))


def _rub(velocity: Any, largest_change: Any) -> Any:
    """Velocity after dry friction with a given impulse over inertia: the body slows down or stops, but never reverses.

    The implicit step for a set-valued friction law (Moreau 1988); a body at rest is held exactly.
    """
    return ca.sign(velocity) * ca.fmax(ca.fabs(velocity) - largest_change, 0.0)


@one_at_a_time
@lru_cache(maxsize=8)
def fine_steps(drives: int) -> Any:
    """CasADi function (state, command, disturbance, step, parameters) -> state, over `BLOCK` fine steps.

    Semi-implicit Euler: velocities from the old positions, positions from the new velocities, dry friction implicit.
    Inputs: state as in `states`, commanded output torque of each drive (drives,) [N m], disturbance torque on the
    load [N m], fine step [s], `LOAD_PARAMETERS` and then `DRIVE_PARAMETERS` of each drive.
    """
    z = ca.SX.sym("z", states(drives))
    command = ca.SX.sym("command", drives)
    disturbance = ca.SX.sym("disturbance")
    h = ca.SX.sym("h")
    parameters = ca.SX.sym("p", len(LOAD_PARAMETERS) + drives * len(DRIVE_PARAMETERS))
    numbers = ca.vertsplit(parameters)
    p = dict(zip(LOAD_PARAMETERS, numbers, strict=False))
    of_drives = numbers[len(LOAD_PARAMETERS) :]

    x, v = z[0], z[1]
    load = (
        disturbance
        + p["torque_offset"]
        - p["gravity"] * ca.cos(x)
        - p["gravity_offset"] * ca.sin(x)
        - p["viscous_friction"] * v
        - p["quadratic_drag"] * v * ca.fabs(v)
        + p["cogging_amplitude"] * ca.sin(p["cogging_order"] * x + p["cogging_phase"])
    )
    rotors, rates, least, motors = [], [], [], []
    for i in range(drives):
        d = dict(zip(DRIVE_PARAMETERS, of_drives[i * len(DRIVE_PARAMETERS) :], strict=False))
        q, w, least_before, before = (z[2 + row * drives + i] for row in range(4))
        motor = motor_torque(
            before,
            command[i],
            w,
            lag=ca.exp(-h / p["current_lag"]),
            stall_torque=d["stall_torque"],
            emf_damping=d["emf_damping"],
        )
        passed = contact_torque(
            q - x, w - v, half_backlash=d["half_backlash"], stiffness=p["flank_stiffness"], damping=p["flank_damping"]
        )
        load += passed
        free = w + h / d["rotor_inertia"] * (motor - passed - d["rotor_viscous"] * w)
        friction = d["rotor_coulomb"] + p["mesh_friction"] * ca.fabs(passed)
        w_next = _rub(free, h / d["rotor_inertia"] * friction)
        rates.append(w_next)
        rotors.append(q + h * w_next)
        least.append(ca.fmin(least_before, d["direction"] * passed))
        motors.append(motor)
    stribeck = p["breakaway_excess"] * ca.exp(-((v / p["stribeck_velocity"]) ** 2))
    v_next = _rub(v + h / p["inertia"] * load, h / p["inertia"] * (p["coulomb_friction"] + stribeck))
    z_next = ca.vertcat(x + h * v_next, v_next, *rotors, *rates, *least, *motors)
    step = ca.Function("fine_step", [z, command, disturbance, h, parameters], [z_next])
    end = z
    for _ in range(BLOCK):
        end = step(end, command, disturbance, h, parameters)
    return ca.Function("fine_steps", [z, command, disturbance, h, parameters], [end], {"cse": True})
