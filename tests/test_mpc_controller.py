"""The controller meets its specification at every sample, for any input."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from four_hertz import four_hertz
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from allocation import InfeasibleTorque
from mpc import Control, Controller
from mpc.quadratic_program import QuadraticProgram
from mpc.slots import Path
from plant import ServoModel
from plant.effects import ActuatorLag, Backlash, Cogging, DeadZone, InputDelay, TorqueSaturation
from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]

PAPER = GearTrain.paper()
UNEQUAL = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
QUIET = {"printLevel": "none"}
RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)


def interpreted(controller: Controller) -> Controller:
    """The controller without machine code, so that its parts can be replaced."""
    controller._step = controller._interpreted
    return controller


def promised(controller: Controller, control: Control) -> None:
    """Check the bounds over the whole horizon, to the last bit, and the form of the status."""
    xi = control.predicted_torques
    assert xi.shape == (controller.horizon, 2)
    assert np.array_equal(control.torques, xi[0])
    assert np.all(xi[:, 0] >= controller.min_torque)
    assert np.all(xi[:, 1] <= -controller.min_torque)
    assert np.all(np.abs(xi) <= controller.max_torque)
    assert control.status == "optimal" or control.status.startswith("degraded: ")
    assert np.isfinite(control.margin)


hostile = st.one_of(
    st.floats(-1, 1),
    st.sampled_from([float("nan"), float("inf"), -float("inf"), 1e300, -1e18, 1e6, 0.0]),
)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(hostile, hostile), min_size=1, max_size=12),
    st.sampled_from([PAPER, UNEQUAL]),
    st.sampled_from([0.0, 1e-5]),
    st.sampled_from([RIGID, ServoModel.paper(), RIGID.with_effect(InputDelay(time=0.012))]),
)
def test_it_keeps_the_bounds_whatever_it_is_fed(
    samples: list[tuple[float, float]], gears: GearTrain, rotor: float, model: ServoModel
) -> None:
    controller = four_hertz(model, gears, horizon=8, rotor_inertia=rotor)
    for angle, reference in samples:
        control = controller.step(angle, reference)
        promised(controller, control)
        if not np.isfinite(angle) or not np.isfinite(reference):
            assert control.status != "optimal"


def ungoverned(controller: Controller, wanted: float) -> None:
    """Replace the governed reference by a constant wanted angle."""

    def aim(previewed: bool) -> int:
        controller._arrays["ahead"][:], controller._arrays["speeds"][:] = wanted, 0.0
        return 0

    controller._interpreted._aim.aim = aim  # type: ignore[method-assign]


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.4, 0.4), st.integers(2, 25), st.floats(-0.05, 0.05))
def test_the_torques_solve_the_program_as_written(start: float, horizon: int, target: float) -> None:
    """Compared with one large program in states and torques, solved by another solver."""
    J, K, dt = 2.0, 0.8, 0.005
    model = ServoModel(inertia=J, gravity=0.0, viscous_friction=K)
    controller = interpreted(four_hertz(model, PAPER, horizon=horizon))
    ungoverned(controller, start + target)
    control = controller.step(start, np.full(horizon + 1, start + target))

    block = expm(np.array([[0, 1, 0], [0, -K / J, 1 / J], [0, 0, 0]]) * dt)
    A, B = block[:2, :2], block[:2, 2]
    N, P, s = horizon, controller._terminal_weight, controller._rate_weight
    count = 3 * N  # angle and velocity of samples 1..N, then torques of samples 0..N-1
    H, g = np.zeros((count, count)), np.zeros(count)
    for k in range(N - 1):
        H[2 * k, 2 * k] += 1.0
        g[2 * k] -= start + target
    end = slice(2 * N - 2, 2 * N)
    H[end, end] += P
    g[end] -= P @ [start + target, 0.0]
    rates = np.zeros((N, count))
    rates[:, 2 * N :] = np.eye(N) - np.eye(N, k=-1)
    H += s * rates.T @ rates
    rows, rhs = np.zeros((2 * N, count)), np.zeros(2 * N)
    for k in range(N):
        rows[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.eye(2)
        rows[2 * k : 2 * k + 2, 2 * N + k] = -B
        if k > 0:
            rows[2 * k : 2 * k + 2, 2 * k - 2 : 2 * k] = -A
        else:
            rhs[:2] = A @ [start, 0.0]
    reach = 8.05 * (0.3 - 0.02)
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    lower[2 * N :], upper[2 * N :] = -reach, reach
    solver = ca.conic("reference", "qpoases", {"h": ca.DM(H).sparsity(), "a": ca.DM(rows).sparsity()}, QUIET)
    scale = 1e3  # of the cost: qpOASES stops too early with small numbers
    answer = solver(h=scale * H, g=scale * g, a=rows, lba=rhs, uba=rhs, lbx=lower, ubx=upper)
    assert solver.stats()["success"]
    x = np.asarray(answer["x"])[:, 0]
    assert control.status == "optimal"
    assert PAPER.output_torque(control.predicted_torques) == pytest.approx(x[2 * N :], abs=1e-5 * reach)
    assert control.predicted_angle[1:] == pytest.approx(x[: 2 * N : 2], abs=1e-6)


WAVY = RIGID.with_effect(Cogging(amplitude=1.5, order=200.0, phase=0.3))


def nonlinear_optimum(controller: Controller, start: float, wanted: Array) -> Array:
    """(N,) output torques by a nonlinear solver for the model, from rest without an earlier torque.

    The feedforward torque has no cost.
    """
    fed = np.diff(controller._arrays["feed"])
    N, stage, p = controller.horizon, controller.estimator.predictor.stage, controller.estimator.predictor.parameters
    tau, state, cost, last = ca.SX.sym("tau", N), ca.SX([start, 0.0]), ca.SX(0), ca.SX(0)
    for k in range(N):
        state = stage(state, ca.vertcat(tau[k], last), p)[0]
        cost += controller._rate_weight * (tau[k] - last - fed[k]) ** 2
        if k < N - 1:
            cost += (state[0] - wanted[k + 1]) ** 2
        last = tau[k]
    miss = state - ca.vertcat(wanted[-1], 0.0)
    cost += ca.mtimes(miss.T, ca.mtimes(ca.DM(controller._terminal_weight), miss))
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "tol": 1e-12}}
    solver = ca.nlpsol("nonlinear", "ipopt", {"x": tau, "f": 1e6 * cost}, quiet)
    reach = 8.05 * (0.3 - 0.02)
    return np.asarray(solver(x0=0.0, lbx=-reach, ubx=reach)["x"])[:, 0]


def test_a_full_solution_is_that_of_the_nonlinear_program() -> None:
    errors = []
    for iterations in (1, 30):
        controller = interpreted(four_hertz(WAVY, PAPER, horizon=12, sqp_iterations=iterations))
        ungoverned(controller, 0.104)
        wanted = np.full(13, 0.104)
        control = controller.step(0.1, wanted)
        assert control.status == "optimal"
        best = nonlinear_optimum(controller, 0.1, wanted)
        errors.append(np.max(np.abs(PAPER.output_torque(control.predicted_torques) - best)))
    assert errors[1] < 1e-5
    assert errors[0] > 1e-3


def test_the_preload_is_the_least_that_the_bounds_allow() -> None:
    controller = four_hertz(RIGID, UNEQUAL, horizon=10)
    control = controller.step(0.0, 0.05)
    held = np.min(np.abs(control.predicted_torques), axis=1)
    assert held == pytest.approx(0.02, abs=1e-12)
    assert control.margin == pytest.approx(0.0, abs=1e-12)


def test_the_preload_accelerates_heavy_rotors() -> None:
    rotor = 2e-5
    # a load that falls with increasing acceleration: drive 1 only keeps contact, and its rotor must accelerate too
    controller = four_hertz(replace(RIGID, gravity=2.0), PAPER, horizon=10, rotor_inertia=rotor)
    control = controller.step(0.0, -2.0 * (0.005 * np.arange(11)) ** 3)
    assert control.status == "optimal"
    # Newton's law for each rotor, seen from its pinion, at the predicted acceleration of the load
    speeds = np.diff(control.predicted_angle) / 0.005
    acceleration = np.diff(speeds) / 0.005
    inertia = rotor * PAPER.pre_reduction**2
    mean = (control.predicted_torques[1:] + control.predicted_torques[:-1]) / 2  # over a second difference
    flank_1 = mean[:, 0] + inertia * 8.05 * acceleration
    flank_2 = -mean[:, 1] - inertia * 8.05 * acceleration
    assert np.ptp(acceleration) > 0.05
    assert flank_1 == pytest.approx(0.02, abs=2e-5)
    assert np.min(flank_2) > 0.018
    assert control.margin == pytest.approx(0.0, abs=1e-9)


def test_too_heavy_rotors_are_reported() -> None:
    controller = four_hertz(RIGID, PAPER, horizon=10, max_torque=0.03, rotor_inertia=1e-2)
    controller.step(0.0, 0.0)
    statuses = [controller.step(0.001 * k**2, 0.0).status for k in range(3)]
    assert any("contact" in status or "jumped" in status for status in statuses)


def test_the_margin_is_the_least_of_the_horizon() -> None:
    # at rest now, but the later acceleration is too high to keep contact with these rotors
    controller = four_hertz(
        ServoModel(inertia=2.0, gravity=0.0), PAPER, horizon=10, max_torque=0.03, rotor_inertia=1e-2
    )
    control = controller.step(0.0, np.where(np.arange(11) < 6, 0.0, 0.01))
    assert control.status == "degraded: max_torque is too low to keep contact at the predicted acceleration"
    taken = 1e-2 * PAPER.pre_reduction**2 * 8.05 * np.diff(control.predicted_angle, 2) / 0.005**2
    flanks = np.abs(control.predicted_torques[1:]) + np.outer(taken, [1, -1])
    assert control.margin == pytest.approx(np.min(flanks) - 0.02, rel=0.1)


def test_a_reading_that_is_not_a_number_is_bridged() -> None:
    controller = four_hertz(RIGID, PAPER)
    first = controller.step(float("nan"), 0.0)
    assert first.status == "degraded: the angle is not a number"
    promised(controller, first)
    assert controller.step(0.0, 0.0).status == "optimal"
    bridged = controller.step(float("nan"), 0.0)
    assert "not a number" in bridged.status
    assert controller.step(0.0, 0.0).status == "optimal"
    controller.estimator.state = None
    assert np.isnan(controller.step(float("nan"), 0.0).predicted_angle).all()
    assert controller._plan is None


def costs_the_plan_and_nothing_else(controller: Controller, planned: Array) -> None:
    control = controller.step(0.0, 0.01)
    promised(controller, control)
    assert "was not solved" in control.status
    assert control.residual == np.inf
    assert control.predicted_torques[:-1] == pytest.approx(planned[1:], abs=1e-9)
    assert controller._plan is None


@pytest.mark.parametrize("answer", [np.nan, 1e9, 0.0])
def test_a_solver_that_fails_costs_the_plan_and_nothing_else(monkeypatch: pytest.MonkeyPatch, answer: float) -> None:
    def fail(program: QuadraticProgram) -> float:
        program.e[:] = answer
        return np.inf

    controller = interpreted(four_hertz(RIGID, PAPER))
    planned = controller.step(0.0, 0.01).predicted_torques
    with monkeypatch.context() as broken:
        broken.setattr(QuadraticProgram, "solve", fail)
        costs_the_plan_and_nothing_else(controller, planned)
    assert controller.step(0.0, 0.01).status == "optimal"


@pytest.mark.parametrize("compiled", [True, False])
def test_an_early_stop_of_the_solver_costs_only_the_plan(compiled: bool) -> None:
    controller = four_hertz(RIGID, PAPER)
    if not compiled:
        interpreted(controller)
    elif not controller.compiled:
        pytest.skip("no C compiler here")
    planned = controller.step(0.0, 0.01).predicted_torques
    rounds = controller._machine_code.layout.rounds
    controller._machine_code.layout.rounds = controller._interpreted.program.rounds = 0
    costs_the_plan_and_nothing_else(controller, planned)
    controller._machine_code.layout.rounds = controller._interpreted.program.rounds = rounds
    assert controller.step(0.0, 0.01).status == "optimal"


def test_the_residual_of_the_solution_is_handed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(QuadraticProgram, "solve", lambda program: 3e-7)
    control = interpreted(four_hertz(RIGID, PAPER)).step(0.0, 0.0)
    assert control.status == "optimal"
    assert control.residual == 3e-7


def test_equal_inputs_give_equal_torques() -> None:
    one, two = four_hertz(ServoModel.paper(), PAPER), four_hertz(ServoModel.paper(), PAPER)
    for angle in np.linspace(0, 0.01, 5):
        assert np.array_equal(one.step(angle, 0.1).torques, two.step(angle, 0.1).torques)


def test_a_number_means_that_the_reference_goes_on() -> None:
    held, previewed = four_hertz(RIGID, PAPER), four_hertz(RIGID, PAPER)
    for k in range(60):
        speed = 0.1 * 0.005
        a = held.step(speed * k, speed * k)
        b = previewed.step(speed * k, speed * (k + np.arange(31)))
    assert a.torques == pytest.approx(b.torques, abs=0.02)
    jumped = four_hertz(RIGID, PAPER)
    for reference in (0.0, 0.0, 0.5):
        control = jumped.step(0.0, reference)
    assert np.max(control.predicted_angle) < 0.1


@pytest.mark.parametrize(
    ("effect", "seconds"), [(InputDelay(time=0.012), 0.010), (ActuatorLag(time_constant=0.02), 0.0)]
)
def test_states_and_delays_of_effects_are_kept(effect: InputDelay | ActuatorLag, seconds: float) -> None:
    controller = four_hertz(RIGID.with_effect(effect), PAPER)
    assert controller._whole_delay * 0.005 == pytest.approx(seconds)
    for _ in range(5):
        control = controller.step(0.0, 0.01)
    promised(controller, control)
    assert control.status == "optimal"


def test_backlash_that_the_preload_closes_is_left_out() -> None:
    with_gap, without = (
        four_hertz(model, PAPER) for model in (RIGID.with_effect(Backlash(gap=0.02, motor_share=0.3)), RIGID)
    )
    for angle in (0.0, 0.001, 0.003):
        assert np.array_equal(with_gap.step(angle, 0.1).torques, without.step(angle, 0.1).torques)


def test_a_torque_that_the_drive_cannot_give_is_not_planned() -> None:
    controller = four_hertz(RIGID.with_effect(TorqueSaturation(limit=1.0)), PAPER)
    most = [np.max(np.abs(PAPER.output_torque(controller.step(0.0, 1.0).predicted_torques))) for _ in range(60)]
    assert max(most) == pytest.approx(1.0, abs=1e-9)  # of the 2.25 N m of the pinions


def test_torques_inside_a_dead_zone_are_avoided() -> None:
    controller = four_hertz(ServoModel(gravity=0.0, effects=(DeadZone(half_width=0.5),)), PAPER)
    for _ in range(40):
        control = controller.step(0.0, 0.001)
    assert abs(float(PAPER.output_torque(control.torques))) > 0.5


def test_the_plan_stays_within_what_a_dead_zone_lets_through() -> None:
    controller = four_hertz(ServoModel(gravity=0.0, effects=(DeadZone(half_width=0.5),)), PAPER)
    for reference in (1.0, -1.0):
        control = controller.step(0.0, np.full(31, reference))
        torques = PAPER.output_torque(control.predicted_torques)
        assert controller._plan is not None
        wide = np.abs(controller._plan) > 0.05  # outside the ramp against chattering of small torques
        assert np.max(np.abs(controller._plan)) > 1.0
        assert controller._plan[wide] == pytest.approx((torques - np.clip(torques, -0.5, 0.5))[wide], abs=1e-9)


def test_the_governed_reference_waits_for_a_load_that_is_stuck() -> None:
    controller, rng = four_hertz(RIGID, PAPER), np.random.default_rng(0)
    ahead = []
    for _ in range(400):
        controller.step(rng.normal(scale=2e-5), 1.0)  # a value constant to the last bit would be an encoder fault
        ahead.append(abs(float(controller.governor.path[Path.ANGLE])))
    assert 1e-3 < max(ahead) < 0.05


@pytest.mark.parametrize(
    "bad",
    [
        {"sample_time": 0.0},
        {"horizon": 1},
        {"horizon": 3.5},
        {"min_torque": -1.0},
        {"max_torque": float("nan")},
        {"bandwidth": 0.0},
        {"bandwidth": 50.0},
        {"encoder_resolution": 0.0, "encoder_noise": 0.0},
        {"torque_noise": float("inf")},
        {"rotor_inertia": -1e-6},
        {"sqp_iterations": 0},
        {"torque_rate": 0.0},
        {"preload_rate": float("nan")},
        {"sqp_iterations": 2.5},
        {"sqp_iterations": 10**9},
        {"horizon": 10**9},
        {"sample_time": "0.005"},
        {"max_torque": "strong"},
        {"max_torque": 1e300},
        {"encoder_range": 1e-9},
        {"speed_limit": None},
    ],
)
def test_refuses_parameters_that_cannot_be(bad: dict[str, float]) -> None:
    with pytest.raises(BadParameter, match=f"(?i){next(iter(bad))}|sensor"):
        four_hertz(RIGID, PAPER, **bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("numbers", [{"sample_time": 1000.0}, {"sample_time": 1e-300}, {"encoder_noise": 1e11}])
def test_numbers_out_of_proportion_end_in_one_sentence(numbers: dict[str, float]) -> None:
    light = ServoModel(inertia=1e-9, viscous_friction=0.1)
    with pytest.raises(BadParameter, match=r"out of proportion; check their units \(SI\)\."):
        Controller(light, PAPER, **numbers)


def test_a_load_that_stops_within_a_sample_is_tuned() -> None:
    assert Controller(ServoModel(inertia=0.01, viscous_friction=10.0), PAPER, sample_time=0.001).bandwidth > 0.1


def test_refuses_what_admits_no_torque_and_what_has_no_gears() -> None:
    with pytest.raises(InfeasibleTorque):
        four_hertz(RIGID, PAPER, min_torque=0.4, max_torque=0.3)
    with pytest.raises(BadParameter, match="Ratios"):
        four_hertz(ServoModel(gravity=0.0, axis="linear"), PAPER)


@pytest.mark.parametrize("shape", [(3,), (30,), (31, 1)])
def test_refuses_a_preview_of_another_length(shape: tuple[int, ...]) -> None:
    with pytest.raises(BadParameter, match="31"):
        four_hertz(RIGID, PAPER).step(0.0, np.zeros(shape))
