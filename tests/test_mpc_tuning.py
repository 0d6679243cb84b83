"""The automatic tuning has margins for any size of machine, encoder, dead time and lag."""

from __future__ import annotations

import numpy as np
import pytest

from mpc import Controller, analyse_loop, closed_loop
from mpc.tuning import Tuning
from plant import GearTrain, Rig, ServoModel
from plant.effects import ActuatorLag, CoulombFriction, Effect, InputDelay, SensorLag, StribeckFriction

PAPER = GearTrain.paper()
PAIR = GearTrain(pinion_teeth=(20, 20), output_teeth=161)


@pytest.mark.parametrize("sample_time", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("inertia", [1e-4, 1e-2, 1.0, 20.0])
def test_the_peak_sensitivity_is_below_two(inertia: float, sample_time: float) -> None:
    model = ServoModel(inertia=inertia, gravity=0.1 * inertia, viscous_friction=0.1 * inertia)
    controller = Controller(model, PAPER, sample_time=sample_time)
    loop = analyse_loop(controller)
    assert loop.peak_sensitivity < 2.0
    assert loop.delay_margin > sample_time
    assert controller.horizon * sample_time >= 0.25 / controller.bandwidth - 1e-9


@pytest.mark.parametrize(
    ("settles", "sample_time"),
    [
        *((0.5, 0.005), (5.0, 0.001), (50.0, 0.001), (50.0, 0.005)),
        *(pytest.param(*each, marks=pytest.mark.long) for each in ((0.5, 0.001), (5.0, 0.005))),
    ],
)
def test_an_axis_of_viscous_friction_alone_is_as_fast(settles: float, sample_time: float) -> None:
    """The axis settles within a sample: K Ts/J is above one. Euler integration gave 0.64 Hz, or an error."""
    model = ServoModel(inertia=sample_time / settles, gravity=0.0, viscous_friction=1.0)
    controller = Controller(model, PAPER, sample_time=sample_time)
    loop = analyse_loop(controller)
    assert loop.peak_sensitivity < 2.0
    assert controller.bandwidth * sample_time > 0.03


@pytest.mark.parametrize(
    "effects",
    [
        (InputDelay(time=0.002),),
        (InputDelay(time=0.013), CoulombFriction(torque=0.3)),
        (ActuatorLag(time_constant=0.02), StribeckFriction(coulomb=0.2, excess=0.2, velocity=0.05)),
        (SensorLag(time_constant=0.01),),
    ],
    ids=["delay", "delay, friction", "lag, friction", "sensor"],
)
@pytest.mark.parametrize("velocity", [0.0, 0.3])
def test_so_it_is_with_friction_and_lateness_at_rest_and_moving(effects: tuple[Effect, ...], velocity: float) -> None:
    loop = analyse_loop(Controller(ServoModel(effects=effects), PAPER), angle=0.3, velocity=velocity)
    assert loop.peak_sensitivity < 2.0


@pytest.mark.parametrize(
    ("inertia", "late"),
    [
        *((0.02, 0.002), (0.02, 0.01), (0.2, 0.004)),
        *(pytest.param(*each, marks=pytest.mark.long) for each in ((0.02, 0.004), (0.2, 0.002), (0.2, 0.01))),
    ],
)
def test_a_controller_settles_by_itself_while_friction_holds(inertia: float, late: float) -> None:
    """With a held load the loop is open: a controller that is unstable by itself would oscillate at rest."""
    model = ServoModel(inertia=inertia, gravity=0.1, viscous_friction=0.02, effects=(InputDelay(time=late),))
    fine = {"encoder_resolution": 2 * np.pi / 2**20, "encoder_noise": 2e-6}
    loop = analyse_loop(Controller(model, PAPER, **fine))  # type: ignore[arg-type]
    poles = np.abs(loop.controller.poles())
    integrator = np.argmin(np.abs(loop.controller.poles() - 1.0))
    assert np.max(np.delete(poles, integrator)) < 0.95
    assert loop.peak_sensitivity < 2.0
    assert loop.delay_margin > 0.005


def test_a_light_axis_read_late_keeps_contact_while_it_sticks() -> None:
    axis = {"inertia": 0.02, "gravity": 0.1, "viscous_friction": 0.02}
    rig = Rig(
        gears=PAIR, coulomb_friction=0.45, encoder_delay=0.004, encoder_counts=2**20, encoder_noise=2e-6,
        flank_stiffness=5e3, flank_damping=1.0, **axis,  # type: ignore[arg-type]
    )  # fmt: skip
    effects = (CoulombFriction(torque=0.45), InputDelay(time=0.004))
    model = ServoModel(effects=effects, **{**axis, "inertia": rig.total_inertia})
    fine = {"encoder_resolution": 2 * np.pi / 2**20, "encoder_noise": 2e-6, "motor_friction": 5e-4}
    controller = Controller(model, PAIR, rotor_inertia=4e-6, **fine)  # type: ignore[arg-type]
    loop = closed_loop(controller, rig, lambda t: 0.01 * (np.floor(t / 0.8) % 2), 1.2, seed=100)
    assert loop.minimum_contact_torque > 0.1
    assert np.std(np.diff(PAIR.output_torque(loop.torques))[40:150]) < 0.05  # it was 0.5 N m at rest


def test_a_bandwidth_that_is_wanted_brings_the_rest() -> None:
    given = Controller(ServoModel(), PAPER, bandwidth=1.5)
    chosen = Tuning.of(ServoModel(), sample_time=0.005, noise=1e-5, least=0.1, greatest=2.0, bandwidth=1.5)
    assert (given.bandwidth, given.horizon) == (1.5, chosen.horizon) == (1.5, 34)
    assert analyse_loop(given).peak_sensitivity < 2.0
    assert Controller(ServoModel(), PAPER, horizon=12, disturbance_rate=0.0).disturbance_rate == 0.0


def test_a_better_encoder_and_more_preload_make_it_faster() -> None:
    plain, sharp, pressed, late = (
        Controller(model, PAPER, **options).bandwidth  # type: ignore[arg-type]
        for model, options in (
            (ServoModel(), {}),
            (ServoModel(), {"encoder_resolution": 1e-6, "encoder_noise": 1e-6}),
            (ServoModel(), {"min_torque": 0.05}),
            (ServoModel(effects=(InputDelay(time=0.02),)), {}),
        )
    )
    assert late < plain < pressed < sharp


def test_the_contact_of_the_paper_is_kept() -> None:
    rig = Rig.paper_like()
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    loop = closed_loop(Controller(model, PAPER), rig, lambda t: 0.2 * (1 - np.cos(2 * np.pi * 0.25 * t)), 2.0, seed=0)
    assert loop.minimum_contact_torque > 0
    assert loop.degraded == 0


def test_a_bandwidth_above_the_default_keeps_the_contact() -> None:
    rig = Rig.paper_like()
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    for bandwidth in (4.0, 5.0):
        controller = Controller(model, PAPER, bandwidth=bandwidth)
        loop = closed_loop(controller, rig, lambda t: 0.2 * (1 - np.cos(2 * np.pi * 0.25 * t)), 2.0, seed=0)
        assert loop.minimum_contact_torque > 0


def test_a_known_reference_is_followed_whatever_the_bandwidth() -> None:
    rig = Rig.paper_like(motor_coulomb=0.0)
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    for bandwidth in (1.0, 2.0, 4.0):
        controller = Controller(model, PAPER, bandwidth=bandwidth)
        loop = closed_loop(controller, rig, lambda t: 0.2 * (1 - np.cos(2 * np.pi * 0.25 * t)), 6.0, seed=0)
        error = (loop.angle - loop.reference)[400:]
        assert np.sqrt(np.mean(error**2)) < 2e-5  # half a count of the encoder
