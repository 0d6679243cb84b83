"""Torques on the load: gravity, friction with exact stiction, and the torques of hidden effects.

    J x'' = tau - alpha cos x - K x' + sum of torques - dry friction

Every torque is a plain function of angle, velocity and time; dry friction is a level for each direction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import cos, exp, pi, sin

Values = Mapping[str, float]
Torque = Callable[[float, float, float], float]  # angle, velocity, time -> [N m]
Level = Callable[[float, float, float], tuple[float, float]]  # velocity, time, torque at the load -> [N m] each way


def smooth_torque(name: str, p: Values) -> Torque | None:
    """The torque of an effect, None if it adds none."""
    if name == "quadratic_drag":
        return lambda x, v, t: -p["drag"] * v * abs(v)
    if name == "gravity_offset":
        return lambda x, v, t: -p["beta"] * sin(x)
    if name == "cable_stiffness":
        k, k3, rest = p["stiffness"], p["cubic"], p["rest_angle"]
        return lambda x, v, t: -(k + k3 * (x - rest) ** 2) * (x - rest)
    if name == "cogging":
        return lambda x, v, t: p["amplitude"] * sin(p["order"] * x + p["phase"])
    if name == "end_stop":
        limit, k = p["angle"], p["stiffness"]
        return lambda x, v, t: -abs(k) * (max(x - limit, 0.0) if k > 0.0 else min(x - limit, 0.0))
    if name == "periodic_disturbance":
        return lambda x, v, t: p["amplitude"] * sin(2.0 * pi * p["frequency"] * t + p["phase"])
    if name == "asymmetric_friction":
        return lambda x, v, t: -p["viscous_difference"] * abs(v)
    if name == "friction_drift":
        return lambda x, v, t: -p["viscous_rate"] * t * v
    if name == "payload_change":
        return lambda x, v, t: -p["gravity"] * cos(x) if t >= p["time"] else 0.0
    return None


def dry_level(name: str, p: Values) -> Level | None:
    """The dry friction of an effect against forward and backward motion, None if it adds none."""
    if name == "coulomb_friction":
        return lambda v, t, arriving: (p["torque"], p["torque"])
    if name == "asymmetric_friction":
        return lambda v, t, arriving: (p["forward"], p["backward"])
    if name == "stribeck_friction":

        def curve(v: float, t: float, arriving: float) -> tuple[float, float]:
            level = p["coulomb"] + p["excess"] * exp(-((v / p["velocity"]) ** 2))
            return level, level

        return curve
    if name == "load_dependent_friction":
        return lambda v, t, arriving: (p["coefficient"] * abs(arriving),) * 2
    if name == "friction_drift" and p["coulomb_rate"] > 0.0:
        return lambda v, t, arriving: (p["coulomb_rate"] * max(t, 0.0),) * 2
    return None


@dataclass
class Load:
    """One load with its torques.

    Attributes:
        inertia: of everything that moves with the load [kg m^2].
        gravity: alpha [N m].
        viscous_friction: K [N m s/rad].
        added: time integral of the torque of each effect since the last reset [N m s].
    """

    inertia: float
    gravity: float
    viscous_friction: float
    effects: Mapping[str, Values]
    rest: Torque | None = None
    added: dict[str, float] = field(default_factory=dict)
    bristle: float = 0.0  # torque of a presliding contact [N m]

    def __post_init__(self) -> None:
        smooth = {name: smooth_torque(name, p) for name, p in self.effects.items()} | {"rest": self.rest}
        self.torques = [(name, torque) for name, torque in smooth.items() if torque is not None]
        levels = {name: dry_level(name, p) for name, p in self.effects.items()}
        self.levels = [(name, level) for name, level in levels.items() if level is not None]
        self.contact = self.effects.get("presliding_hysteresis")
        self.change = self.effects.get("payload_change")

    def inertia_at(self, t: float) -> float:
        """Inertia at a time [kg m^2]."""
        return self.inertia + (self.change["inertia"] if self.change and t >= self.change["time"] else 0.0)

    def passive(self, x: float, v: float, t: float, travel: float) -> float:
        """Torque on the load without the drive's and without dry friction, `travel` after the start of a step [N m]."""
        torque = -self.gravity * cos(x) - self.viscous_friction * v
        for _, own in self.torques:
            torque += own(x, v, t)
        return torque - self.slid(travel) if self.contact else torque

    def slid(self, travel: float) -> float:
        """Dahl's friction after a travel in one direction [N m]."""
        if self.contact is None or travel == 0.0:
            return self.bristle
        level = self.contact["torque"] if travel > 0.0 else -self.contact["torque"]
        return level + (self.bristle - level) * exp(-abs(travel) * self.contact["stiffness"] / abs(level))

    def dry(self, v: float, t: float, arriving: float) -> tuple[float, float]:
        """Dry friction against forward and backward motion [N m]."""
        forward = backward = 0.0
        for _, level in self.levels:
            one, other = level(v, t, arriving)
            forward, backward = forward + one, backward + other
        return forward, backward

    def count(self, x: float, v: float, t: float, travel: float, arriving: float, dry: float, h: float) -> None:
        """Add the torque of each effect over a step of length `h`; `dry` is the total dry friction torque."""
        for name, own in self.torques:
            self.added[name] += own(x, v, t) * h
        if self.contact:
            self.added["presliding_hysteresis"] -= self.slid(travel) * h
        if self.levels and dry != 0.0:
            levels = [(name, level(v, t, arriving)[dry > 0.0]) for name, level in self.levels]
            whole = sum(level for _, level in levels)
            for name, level in levels:
                self.added[name] += dry * level / whole * h if whole else 0.0


def slide(v: float, force: float, levels: tuple[float, float], inertia: float, h: float) -> tuple[float, float]:
    """Velocity after a step under a constant force and dry friction, and the travel in it.

    The load slides until it stops; then it sticks while the force is below the level, and otherwise slides on.
    """
    forward, backward = levels
    way = 0.0
    if v != 0.0:
        acceleration = (force - (forward if v > 0.0 else -backward)) / inertia
        after = v + acceleration * h
        if after * v > 0.0 or acceleration == 0.0:
            return after, 0.5 * (v + after) * h
        to_stop = -v / acceleration
        way, h = 0.5 * v * to_stop, h - to_stop
    excess = max(force - forward, 0.0) + min(force + backward, 0.0)
    after = excess / inertia * h
    return after, way + 0.5 * after * h
