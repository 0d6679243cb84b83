"""The fine step of the rig: two rotors, two tooth gaps, one load.

All angles and torques here are referred to the load side, so that a rotor whose angle equals the load's sits in the
middle of its tooth gap.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

import casadi as ca

STATES: Final = 8
"""Load angle, load velocity, 2 rotor angles, 2 rotor velocities, 2 least flank torques so far."""

BLOCK: Final = 10
"""Fine steps that are written out one behind the other: a call costs as much as several steps."""

PARAMETERS: Final = (
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
    "rotor_inertia_1",
    "rotor_inertia_2",
    "rotor_viscous_1",
    "rotor_viscous_2",
    "rotor_coulomb_1",
    "rotor_coulomb_2",
    "half_play",
    "flank_stiffness",
    "flank_damping",
)
"""Order of the parameter vector; rotor quantities are seen from the load."""

REQUIRED_SENSE: Final = (-1.0, 1.0)
"""Sign of the follower torque that each drive must keep up: drive 1 pulls back (xi1 > 0), drive 2 forward (xi2 < 0)."""


def flank_torque(gap: Any, gap_rate: Any, *, half_play: Any, stiffness: Any, damping: Any) -> Any:
    """Torque that a rotor passes to the load through its teeth, seen from the load [N m].

    Dead zone, spring and damper, clipped to pushing (Nordin, Galic, Gutman 1997): inside the play nothing is passed,
    on either flank a tooth can push but never pull, however fast it leaves.

    Args:
        gap: rotor angle less load angle [rad], zero in the middle of the play.
        gap_rate: its derivative [rad/s].
        half_play: half of the free play [rad].
        stiffness: of a flank pair in contact [N m/rad].
        damping: of a flank pair in contact [N m s/rad].
    """
    forward = ca.fmax(0.0, stiffness * (gap - half_play) + damping * gap_rate)
    backward = ca.fmin(0.0, stiffness * (gap + half_play) + damping * gap_rate)
    return ca.if_else(gap > half_play, forward, ca.if_else(gap < -half_play, backward, 0.0))


def _rub(velocity: Any, largest_change: Any) -> Any:
    """Velocity after dry friction of a given impulse over inertia: it slows down, stops, and never turns around.

    The implicit step for a set-valued friction law (Moreau 1988); a body at rest is held exactly.
    """
    return ca.sign(velocity) * ca.fmax(ca.fabs(velocity) - largest_change, 0.0)


@lru_cache(maxsize=64)
def advance_function(blocks: int) -> Any:
    """CasADi function (state, drives, disturbance, step, parameters) -> state, over `blocks` times `BLOCK` fine steps.

    Semi-implicit Euler: velocities from the old positions, positions from the new velocities, dry friction implicit.
    Inputs: state (8,), follower torque of each drive (2,) [N m], torque disturbing the load [N m], fine step [s],
    parameters in the order of `PARAMETERS`.
    """
    z = ca.SX.sym("z", STATES)
    drive = ca.SX.sym("drive", 2)
    disturbance = ca.SX.sym("disturbance")
    h = ca.SX.sym("h")
    parameters = ca.SX.sym("p", len(PARAMETERS))
    p = dict(zip(PARAMETERS, ca.vertsplit(parameters), strict=True))

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
    rotors, rates, least = [], [], []
    for i in range(2):
        q, w = z[2 + i], z[4 + i]
        passed = flank_torque(
            q - x, w - v, half_play=p["half_play"], stiffness=p["flank_stiffness"], damping=p["flank_damping"]
        )
        load += passed
        inertia = p[f"rotor_inertia_{i + 1}"]
        free = w + h / inertia * (drive[i] - passed - p[f"rotor_viscous_{i + 1}"] * w)
        w_next = _rub(free, h / inertia * p[f"rotor_coulomb_{i + 1}"])
        rates.append(w_next)
        rotors.append(q + h * w_next)
        least.append(ca.fmin(z[6 + i], REQUIRED_SENSE[i] * passed))
    stribeck = p["breakaway_excess"] * ca.exp(-((v / p["stribeck_velocity"]) ** 2))
    v_next = _rub(v + h / p["inertia"] * load, h / p["inertia"] * (p["coulomb_friction"] + stribeck))
    z_next = ca.vertcat(x + h * v_next, v_next, *rotors, *rates, *least)
    step = ca.Function("fine_step", [z, drive, disturbance, h, parameters], [z_next])
    end = z
    for _ in range(BLOCK):
        end = step(end, drive, disturbance, h, parameters)
    block = ca.Function("fine_steps", [z, drive, disturbance, h, parameters], [end], {"cse": True})
    return block.fold(blocks) if blocks > 1 else block
