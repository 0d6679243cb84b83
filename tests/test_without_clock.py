"""A model that leaves its log: what depended on the log's clock becomes what it was at the end, or goes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from hidden_effects import CASES

from mpc import Controller
from plant import GearTrain, ServoModel, catalogue, simulate
from plant.effects import (
    Backlash,
    Compliance,
    CoulombFriction,
    Effect,
    FrictionDrift,
    Moment,
    PayloadChange,
    PeriodicDisturbance,
    Stage,
    StribeckFriction,
    TorqueOffset,
)
from plant.effects.effect import parameter
from plant.effects.nonparametric import unnamed
from plant.effects.nonparametric_curve import CurveOverTime

RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
FLEXIBLE = Compliance(frequency=40.0, damping=0.1, motor_share=0.3)
PAYLOAD = PayloadChange(time=23.0, inertia=0.7, gravity=0.3)
HUM = PeriodicDisturbance(amplitude=0.4, frequency=3.3, phase=0.4)
DRIFT = FrictionDrift(viscous_rate=0.004, coulomb_rate=0.002)
COURSE = CurveOverTime(low=0.0, high=60.0, c4=0.3, c8=-0.2)
EXAMPLES = [
    *(catalogue[case.effect](**case.at(case.sizes[2])) for case in CASES),
    *(kind(**{spec.name: 0.1 * k for k, spec in enumerate(kind.parameters(), 1)}) for kind in unnamed.values()),
]


@pytest.mark.parametrize("effect", EXAMPLES, ids=lambda effect: effect.name)
def test_an_effect_declares_whether_it_reads_the_clock(effect: Effect) -> None:
    time, angle, velocity = (ca.SX.sym(name) for name in ("time", "angle", "velocity"))
    at = Moment(time=time, angle=angle, velocity=velocity, torque=1.0, step=0.005)
    laws = [effect.load_torque(at, 0.0), effect.added_inertia(at), *(effect.dry_friction(at) or ())]
    assert effect.clocked == any(ca.depends_on(ca.SX(law), time) for law in laws)


@pytest.mark.parametrize("model", [RIGID, RIGID.with_effect(FLEXIBLE)], ids=["rigid", "flexible"])
def test_a_payload_becomes_part_of_the_load(model: ServoModel) -> None:
    command = 3.0 * np.sin(np.arange(400) * 0.02) + np.repeat([1.0, -1.0], 200)
    before = model.with_effect(replace(PAYLOAD, time=-1.0))  # it came before the simulation begins
    after = model.with_effect(PAYLOAD).without_clock()
    assert after.inertia == pytest.approx(2.7)
    moved, same = (simulate(m, command=command, dt=0.005, substeps=5)[:, :2] for m in (before, after))
    assert np.ptp(moved[:, 0]) > 0.3
    assert same == pytest.approx(moved, abs=1e-9)


def test_the_motor_before_backlash_keeps_its_inertia() -> None:
    model = RIGID.with_effect(Backlash(gap=0.02, motor_share=0.3)).with_effect(PAYLOAD).without_clock()
    gap = model.effect("backlash")
    assert isinstance(gap, Backlash)
    assert gap.motor_share * model.inertia == pytest.approx(0.3 * RIGID.inertia)
    assert gap.gap == 0.02


@pytest.mark.parametrize(
    "others", [(), (CoulombFriction(torque=0.1),), (StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.1),)]
)
def test_friction_stays_where_its_drift_had_taken_it(others: tuple[Effect, ...]) -> None:
    model = replace(RIGID, effects=others).with_effect(DRIFT)
    left = model.without_clock(60.0)
    at = Moment(angle=0.3, velocity=0.7, time=60.0)
    assert float(left.smooth_acceleration(at)) == pytest.approx(float(model.smooth_acceleration(at)))
    assert left.dry_friction(at) == pytest.approx(model.dry_friction(at))
    assert left == left.without_clock()
    assert model.without_clock() == replace(RIGID, effects=others)  # when the log ended is not known


def test_friction_never_falls_below_none() -> None:
    assert RIGID.with_effect(FrictionDrift(viscous_rate=-0.1)).without_clock(60.0) == replace(
        RIGID, viscous_friction=0.0
    )


def test_what_only_the_clock_can_place_goes_and_all_else_stays() -> None:
    others = RIGID.with_effect(CoulombFriction(torque=0.1)).with_effect(FLEXIBLE)
    assert others.with_effect(HUM).with_effect(COURSE).without_clock() == others
    assert others.without_clock() is others


@dataclass(frozen=True, kw_only=True)
class Leak(Effect):
    """Somebody's own: a cylinder that loses pressure down to a level."""

    name = "leak"
    title = "leak"
    stage = Stage.LOAD
    clocked = True
    level: float = parameter("{torque}", "torque that is left")

    def load_torque(self, at: Moment, state: float) -> float:
        return self.level + ca.exp(-at.time)

    def without_clock(self, rest: ServoModel, end: float | None) -> ServoModel:
        return rest.with_effect(TorqueOffset(torque=self.level))


def test_an_effect_of_ones_own_declares_what_it_leaves() -> None:
    assert RIGID.with_effect(Leak(level=0.2)).without_clock() == RIGID.with_effect(TorqueOffset(torque=0.2))


def test_the_controller_keeps_no_clock() -> None:
    found = RIGID.with_effect(PAYLOAD).with_effect(HUM).with_effect(COURSE)
    now = ServoModel(inertia=2.7, gravity=0.8, viscous_friction=0.8)
    mine, theirs = (Controller(model, GearTrain.paper()) for model in (found, now))
    for angle in np.linspace(0.0, 0.02, 5):
        assert mine.step(angle, 0.05).torques == pytest.approx(theirs.step(angle, 0.05).torques, abs=1e-12)
