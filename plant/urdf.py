"""A servo as a joint in URDF, which only has damping, friction, effort limit and inertia.

Format: wiki.ros.org/urdf/XML/joint; `damping` is viscous, `friction` Coulomb's.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, sin

from plant.effects import CoulombFriction, GravityOffset, TorqueSaturation
from plant.servo import ServoModel
from plant.simulator_parts import beyond, native_part

_GRAVITY = 9.81  # [m/s^2]
_WEIGHT = 0.01  # fraction of the inertia carried by the mass that gravity acts on
_TRAVEL = 1000.0  # of a prismatic joint, each way [m]
_NO_EFFORT = 'effort="1e9" velocity="1e9"'
_ROUND = 1e-3  # moment of inertia of a sliding link over its mass, of which the model knows nothing [m^2]


_NATIVE = (CoulombFriction, GravityOffset, TorqueSaturation)  # effects that URDF has attributes for


@dataclass(frozen=True, kw_only=True)
class Urdf:
    """A servo in URDF: the text, and what the format cannot express, a sentence each."""

    text: str
    left_out: tuple[str, ...]


def urdf(model: ServoModel, *, name: str = "antidrive") -> Urdf:
    """A base and a link with one joint, prismatic for a linear axis; copy `<dynamics>` and `<limit>` into your robot.

    Friction that depends on more than the direction is replaced by its nearest Coulomb friction.

    Raises:
        BadParameter: a torque that is not in N m, or a force that is not in N.
    """
    timeless = model.without_clock()
    native, rest = native_part(timeless), beyond(timeless)
    friction, nearest = native.friction, []
    for effect in rest.effects:
        simpler = [one for one in effect.reduced() if isinstance(one, CoulombFriction)]
        friction += sum(one.torque for one in simpler)
        nearest += [effect.title for _ in simpler]
    inertia, turning = native.inertia + native.motor_inertia, hypot(native.gravity, native.quadrature)
    tilt, arm = atan2(native.quadrature, native.gravity), _WEIGHT * inertia if turning else 0.0
    slides = native.axis == "linear"
    mass = turning**2 / (_GRAVITY**2 * arm) if turning else inertia if slides else 1e-6
    reach = turning / (mass * _GRAVITY) if turning else 0.0
    effort = "" if native.limit is None else f'effort="{native.limit:.9g}" velocity="1e9"'
    limit = f"\n    <limit {effort}/>" if effort else ""
    if slides:  # which URDF wants with its travel
        limit = f'\n    <limit lower="-{_TRAVEL:g}" upper="{_TRAVEL:g}" {effort or _NO_EFFORT}/>'
    lost = [e.title for e in model.commanded().effects if not isinstance(e, _NATIVE) and e.title not in nearest]
    left_out = []
    if nearest:
        left_out.append(f"As its nearest Coulomb friction: {', '.join(nearest)}.")
    if lost:
        left_out.append(f"URDF cannot express: {', '.join(lost)}.")
    if slides:
        left_out.append(f"The travel is not in the model: write yours in place of {_TRAVEL:g} m.")
    moments = " ".join(
        f'{axis}="{_ROUND * inertia if slides else inertia - arm:.9g}"' for axis in ("ixx", "iyy", "izz")
    )
    said = "m, N, kg." if slides else "rad, N m, kg m^2; angle zero is where gravity pulls most."
    return Urdf(
        text=f"""<?xml version="1.0"?>
<robot name="{name}">
  <!-- A servo on a bench. {said} Copy dynamics and limit. -->
  <link name="base"/>
  <link name="load">
    <inertial>
      <origin xyz="{reach * cos(tilt):.9g} 0 {0.0 - reach * sin(tilt):.9g}"/>
      <mass value="{mass:.9g}"/>
      <inertia {moments} ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="{name}" type="{"prismatic" if slides else "continuous"}">
    <parent link="base"/>
    <child link="load"/>
    <axis xyz="{"1 0 0" if slides else "0 -1 0"}"/>{limit}
    <dynamics damping="{native.damping:.9g}" friction="{friction:.9g}"/>
  </joint>
</robot>
""",
        left_out=tuple(left_out),
    )
