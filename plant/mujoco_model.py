"""A servo for MuJoCo: MJCF for the effects with attributes, and a Python function for the others.

MJCF reference: mujoco.readthedocs.io, XML reference. A dead time needs the attribute `delay` of an actuator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, sin

import casadi as ca

from plant.code_dialects import python
from plant.code_text import Symbolic, text_of
from plant.discrete import longest_step
from plant.effects import Effect, Stage
from plant.inverse import strength
from plant.servo import ServoModel
from plant.simulator_parts import Beyond, Native, beyond, native_part
from plant.symbolic import one_at_a_time
from plant.units import axis_quantities, printed

_GRAVITY = 9.81  # [m/s^2]
_WEIGHT = 0.01  # fraction of the inertia carried by the mass that gravity acts on; the rest is the armature
_STEP = 5e-4  # longest time step [s]


@dataclass(frozen=True, kw_only=True)
class MujocoModel:
    """A servo for MuJoCo.

    Attributes:
        files: content of each file by name: the MJCF and, if needed, the Python function that steps it.
        native: effects in the MJCF.
        called: effects in the function, by title.
        left_out: omissions, a sentence each.
        timestep: of the simulation [s].
    """

    files: Mapping[str, str]
    native: tuple[str, ...]
    called: tuple[str, ...]
    left_out: tuple[str, ...]
    timestep: float

    def sentences(self) -> list[str]:
        """Location of each effect, in sentences."""
        found = [f"In the MJCF: {', '.join(self.native)}."]
        if self.called:
            why = "MJCF has no attribute for it, or in another order"
            found.append(f"In the Python file, because {why}: {', '.join(self.called)}.")
        return [*found, *self.left_out]


@one_at_a_time
def mujoco_model(model: ServoModel, *, sample_time: float | None = None, name: str = "antidrive") -> MujocoModel:
    """A test bench with one joint in MJCF; copy joint and actuator from it into your robot.

    In a robot whose links have inertia and mass, subtract them from `armature` and the mass here.

    Args:
        model: the servo. A linear axis becomes a slide joint along x, with its mass as armature.
        sample_time: for which a command is held [s]; it is a multiple of the time step.
        name: of the files.

    Raises:
        BadParameter: a torque that is not in N m, or a force that is not in N.
    """
    timeless = model.without_clock()
    native = native_part(timeless)
    longest = min(_STEP, longest_step(timeless, sample_time or _STEP))
    timestep = longest if sample_time is None else sample_time / ceil(sample_time / longest * (1.0 - 1e-9))
    code = _function(timeless, native, name)
    inner = beyond(timeless)
    called = [effect.title for effect in (*inner.effects, *sensor_effects(timeless))]
    own_delay = bool(code) and native.lag == 0.0 and inner.needs(strength(model))
    words = {
        "inertia": True,
        "viscous friction": native.damping > 0.0,
        "gravity": bool(native.gravity or native.quadrature),
        "Coulomb friction": native.friction > 0.0,
        "torque limit": native.limit is not None,
        "actuator lag": native.lag > 0.0,
        "input delay": native.delay > 0.0 and not own_delay,
    }
    if native.delay > 0.0 and own_delay:
        called.insert(0, "input delay")
    files = {f"{name}.xml": _mjcf(native, timestep, name, own_delay=own_delay)}
    if code:
        files[f"{name}_mujoco.py"] = code
    return MujocoModel(
        files=files,
        native=tuple(word for word, there in words.items() if there),
        called=tuple(called),
        left_out=tuple(_left_out(model, timeless)),
        timestep=timestep,
    )


def sensor_effects(model: ServoModel) -> list[Effect]:
    """Effects on the measurement without a state."""
    return [effect for effect in model.effects if effect.stage is Stage.SENSOR and not effect.states]


def _left_out(model: ServoModel, timeless: ServoModel) -> list[str]:
    kept = {effect.name for effect in timeless.effects}
    lost = [e.title for e in timeless.effects if e.name in ("rate_limit", "setpoint_rate_limit", "sensor_lag")]
    clocked = [effect.title for effect in model.effects if effect.name not in kept]
    found = [f"Not in it: {', '.join(lost)}."] if lost else []
    return [
        *found,
        *([f"Left out, because it holds for the log alone: {', '.join(clocked)}."] if clocked else []),
    ]


def _mjcf(native: Native, timestep: float, name: str, *, own_delay: bool) -> str:
    turning, tilt = hypot(native.gravity, native.quadrature), atan2(native.quadrature, native.gravity)
    arm_inertia = _WEIGHT * native.inertia if turning else 0.0
    own, slides = 1e-3 * native.inertia, native.axis == "linear"
    mass = turning**2 / (_GRAVITY**2 * arm_inertia) if turning else own if slides else 1e-6
    reach = turning / (mass * _GRAVITY) if turning else 0.0
    joint = 'type="slide" axis="1 0 0"' if slides else 'type="hinge" axis="0 -1 0"'
    armature = native.inertia - arm_inertia - own
    body = f'<inertial pos="{reach * cos(tilt):.9g} 0 {0.0 - reach * sin(tilt):.9g}" mass="{mass:.9g}" '
    body += f'diaginertia="{own:.9g} {own:.9g} {own:.9g}"/>'
    friction = f' frictionloss="{native.friction:.9g}"'
    hard = f'solreffriction="{2.0 * timestep:.9g} 1" solimpfriction="0.9999 0.9999 1 0.5 1"'
    motor = ""
    if native.motor_inertia:
        motor_mass = f"{native.motor_inertia * 0.001:.9g}" if slides else "1e-6"
        motor = (
            f'    <body name="motor">\n      <joint name="motor" {joint} '
            f'armature="{native.motor_inertia * 0.999:.9g}"/>\n      <inertial pos="0 0 0" mass="{motor_mass}" '
            f'diaginertia="{3 * f"{native.motor_inertia * 0.001:.9g} "}"/>\n    </body>\n'.replace(' "/>', '"/>')
        )
    drive = 'gaintype="fixed" gainprm="1" biastype="none"'
    if native.lag:
        drive += f' dyntype="filterexact" dynprm="{native.lag:.9g}"'
    if native.limit is not None:
        drive += f' forcelimited="true" forcerange="{-native.limit:.9g} {native.limit:.9g}"'
    if native.delay and not own_delay:
        drive += f' delay="{native.delay:.9g}" nsample="{ceil(native.delay / timestep) + 2}" interp="zoh"'
    said = "m, N, kg." if slides else "rad, N m, kg m^2; angle zero is where gravity pulls most."
    return f"""<mujoco model="{name}">
  <!-- A servo on a bench. {said} Copy joint and actuator. -->
  <compiler angle="radian"/>
  <option timestep="{timestep:.9g}" gravity="0 0 -{_GRAVITY}" integrator="Euler"/>
  <worldbody>
{motor}    <body name="load">
      <joint name="load" {joint} armature="{armature:.9g}" damping="{native.damping:.9g}"{friction}
        {hard}/>
      {body}
    </body>
  </worldbody>
  <actuator>
    <general name="{axis_quantities(native.axis)[2]}" joint="{"motor" if native.motor_inertia else "load"}" {drive}/>
  </actuator>
</mujoco>
"""


def _function(model: ServoModel, native: Native, name: str) -> str:
    """The Python file for the MJCF; empty if no effect needs it."""
    own = Symbolic.of(model)
    rest = beyond(model.bound(own.values))
    if not rest.effects and ca.is_equal(rest.measurement, rest.symbols[0], 5):
        return ""
    results = {"motor": rest.motor, "load": rest.load, "friction": rest.friction}
    after = dict(zip((f"next_{r}" for r in rest.remembered), map(ca.SX, rest.after), strict=True))
    text = text_of(results | after, [*rest.symbols, *own.symbols], python())
    needed = ca.vertcat(*results.values(), *after.values(), rest.measurement)
    used = [entry for entry, s in zip(own.parameters, own.symbols, strict=True) if ca.depends_on(needed, s)]
    constants = "\n".join(
        f"{given} = {value!r}  # {': '.join(filter(None, (printed(spec.unit), spec.meaning)))}"
        for given, spec, value in used
    )
    place, length, push, unit = axis_quantities(native.axis)
    shown = text_of({"shown": rest.measurement}, [rest.symbols[0], *own.symbols], python())
    return _TEMPLATE.format(
        name=name,
        what=", ".join(effect.title for effect in (*rest.effects, *sensor_effects(model))),
        constants=constants,
        delay=0.0 if native.lag else native.delay,
        place=place,
        length=length,
        push=push,
        unit=unit,
        limit="math.inf" if native.limit is None else repr(native.limit),
        drive="motor" if native.motor_inertia else "load",
        begin=_lines(f"self.{one} = {'0.0' if k else 'None'}" for k, one in enumerate(rest.remembered)),
        entering=_entering(native, rest),
        motion=_lines(motion for motion in (_MOTOR.format(place=place),) if native.motor_inertia),
        memory=_lines(
            f"{one} = self.{one}" if k else f"{one} = {place} if self.{one} is None else self.{one}"
            for k, one in enumerate(rest.remembered)
        ),
        between=_lines(f"{w.name} = {w.text}" for w in text.between),
        motor=text.results["motor"],
        load=text.results["load"],
        friction=text.results["friction"],
        after=_lines(f"self.{one} = {text.results[f'next_{one}']}" for one in rest.remembered),
        shown=_lines([*(f"{w.name} = {w.text}" for w in shown.between), f"return {shown.results['shown']}"]),
    )


def _lines(lines: Iterable[str]) -> str:
    return "".join(f"\n        {line}" for line in lines)


def _entering(native: Native, rest: Beyond) -> str:
    """Code for the torque after lag and limit."""
    push = axis_quantities(native.axis)[2]
    if not rest.needs(push):
        return "data.ctrl[self.actuator] = command"
    if native.lag:
        return (
            f"data.ctrl[self.actuator] = command\n        {push} = min(max(float(data.act[self.act]), -limit), limit)"
        )
    return (
        "self.late.append(command)\n"
        f"        {push} = min(max(self.late[0], -limit), limit)\n"
        f"        data.ctrl[self.actuator] = {push}"
    )


_MOTOR = "motor_{place}, motor_velocity = data.qpos[self.drive], data.qvel[self.drive]"
_TEMPLATE = '''"""What MuJoCo has no attribute for in {name}.xml: {what}.

    model = mujoco.MjModel.from_xml_path("{name}.xml")
    data, servo = mujoco.MjData(model), Servo(model)
    servo.step(model, data, command)  # {push} [{unit}]; in place of mujoco.mj_step
    servo.measurement(data)           # {place} that the sensor shows [{length}]

It writes data.ctrl, data.qfrc_applied and model.dof_frictionloss of its joint, and nothing else.
"""

import math
from collections import deque

import mujoco

{constants}
delay = {delay!r}  # s: dead time that is kept here, and not by the actuator
limit = {limit}  # {unit}


def sign(x):
    return float(x > 0) - float(x < 0)


class Servo:
    """One servo; one object for each simulation."""

    def __init__(self, model, load="load", drive="{drive}", actuator="{push}"):
        self.place, self.dof = int(model.joint(load).qposadr[0]), int(model.joint(load).dofadr[0])
        self.drive = int(model.joint(drive).dofadr[0])
        self.actuator = model.actuator(actuator).id
        self.act = int(model.actuator_actadr[self.actuator])
        steps = round(delay / model.opt.timestep)
        self.late = deque([0.0] * (steps + 1), maxlen=steps + 1){begin}

    def step(self, model, data, command):
        """One time step under a {push} command [{unit}]."""
        {place}, velocity = data.qpos[self.place], data.qvel[self.dof]{motion}
        {entering}{memory}{between}
        data.qfrc_applied[self.dof] = 0.0
        data.qfrc_applied[self.drive] = {motor}
        data.qfrc_applied[self.dof] += {load}
        model.dof_frictionloss[self.dof] = {friction}{after}
        mujoco.mj_step(model, data)

    def measurement(self, data):
        """What the sensor shows [{length}]."""
        {place} = data.qpos[self.place]{shown}
'''
