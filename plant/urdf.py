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


_NATIVE = (CoulombFriction, GravityOffset, TorqueSaturation)  # effects that URDF has attributes for


@dataclass(frozen=True, kw_only=True)
class Urdf:
    """A servo in URDF: the text, and what the format cannot express, a sentence each."""

    text: str
    left_out: tuple[str, ...]


def urdf(model: ServoModel, *, name: str = "antidrive") -> Urdf:
    """A base and a link with one joint; copy `<dynamics>` and `<limit>` into your robot.

    Friction that depends on more than the direction is replaced by its nearest Coulomb friction.

    Raises:
        BadParameter: a linear axis, or a torque that is not in N m.
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
    mass = turning**2 / (_GRAVITY**2 * arm) if turning else 1e-6
    reach = turning / (mass * _GRAVITY) if turning else 0.0
    limit = "" if native.limit is None else f'\n    <limit effort="{native.limit:.9g}" velocity="1e9"/>'
    lost = [e.title for e in model.commanded().effects if not isinstance(e, _NATIVE) and e.title not in nearest]
    left_out = []
    if nearest:
        left_out.append(f"As its nearest Coulomb friction: {', '.join(nearest)}.")
    if lost:
        left_out.append(f"URDF cannot express: {', '.join(lost)}.")
    moments = " ".join(f'{axis}="{inertia - arm:.9g}"' for axis in ("ixx", "iyy", "izz"))
    return Urdf(
        text=f"""<?xml version="1.0"?>
<robot name="{name}">
  <!-- A servo on a bench. rad, N m, kg m^2; angle zero is where gravity pulls most. Copy dynamics and limit. -->
  <link name="base"/>
  <link name="load">
    <inertial>
      <origin xyz="{reach * cos(tilt):.9g} 0 {0.0 - reach * sin(tilt):.9g}"/>
      <mass value="{mass:.9g}"/>
      <inertia {moments} ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="{name}" type="continuous">
    <parent link="base"/>
    <child link="load"/>
    <axis xyz="0 -1 0"/>{limit}
    <dynamics damping="{native.damping:.9g}" friction="{friction:.9g}"/>
  </joint>
</robot>
""",
        left_out=tuple(left_out),
    )
