"""Linear analysis of the closed loop at an operating point: gain, margins, sensitivity, bandwidth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc.controller import Controller
from mpc.linear_loop import LinearPlant, feedback, filter_gain, law
from plant.errors import BadParameter
from plant.result_display import Drawn
from plant.simulation import beginning

Array = NDArray[np.float64]

_POINTS = 4000
"""Number of frequencies of the grid for peaks and crossings, four decades up to half the sampling rate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopAnalysis(Drawn):
    """The loop, opened where the torque enters the drivetrain.

    Attributes:
        plant: from drive output torque to measurement, `control.StateSpace` with the sample time, dead time included.
        controller: from measurement to torque, sign included.
        gain: L = - plant times controller.
        sensitivity: S = 1/(1 + L), from a torque added to the controller output to the sum of both.
        complementary: T = L/(1 + L); measurement noise acts on the angle with -T.
        gain_margin: factor by which L may grow until the loop oscillates [-]; inf if it never does.
        phase_margin: [deg]; nan if |L| is never 1.
        crossover: highest frequency with |L| = 1 [Hz]; nan if there is none.
        delay_margin: least additional dead time that makes the loop oscillate [s].
        peak_sensitivity: max |S| [-]; below 2 is a good value.
        bandwidth: highest frequency at which |T| falls below -3 dB [Hz].
        torque: drive output torque that holds the operating point [N m].
    """

    plant: Any
    controller: Any
    gain: Any
    sensitivity: Any
    complementary: Any
    gain_margin: float
    phase_margin: float
    crossover: float
    delay_margin: float
    peak_sensitivity: float
    bandwidth: float
    torque: float

    def __repr__(self) -> str:
        """The margins in one line."""
        return (
            f"LoopAnalysis(crossover {self.crossover:.2g} Hz, phase margin {self.phase_margin:.0f} deg, gain margin "
            f"{self.gain_margin:.2f}, peak sensitivity {self.peak_sensitivity:.2f}, bandwidth {self.bandwidth:.2g} Hz)"
        )

    @property
    def frequencies(self) -> Array:
        """(600,) frequencies up to half the sampling rate, for pictures and tables [Hz]."""
        return np.geomspace(1e-3, 0.5, 600) / float(self.gain.dt)

    def response(self, system: Any, frequencies: Array) -> NDArray[np.complex128]:
        """Complex response of one of the systems at frequencies (M,) [Hz]."""
        return np.asarray(system(np.exp(2j * np.pi * frequencies * system.dt)), dtype=np.complex128)


def analyse_loop(controller: Controller, *, angle: float = 0.0, velocity: float = 0.0) -> LoopAnalysis:
    """Linearise model, estimator and predictive controller at an operating point without active bounds.

    The estimator has its stationary gain (Riccati equation). The control law is the first torque of the program of
    `Controller`, a linear function of the estimate and of the torques not yet effective. The reference is constant.

    Args:
        controller: its model and its parameters are used, not its present state.
        angle, velocity: of the load at the operating point [rad], [rad/s], kept by a constant torque.

    Raises:
        BadParameter: the controller uses motor encoders (not supported by this analysis), or no torque keeps the
            operating point.
    """
    import control  # slow import (about a second), so only where it is needed

    if controller.motor_resolution is not None:
        raise BadParameter("The analysis of the loop is for the load's encoder alone; leave motor_resolution out.")
    dt, late = controller.sample_time, controller._whole_delay
    torque, state = _holding(controller, angle, velocity)
    predictor = controller.estimator.predictor
    course = predictor.look_ahead(state, np.array([torque, torque]), 0.0)
    A, B = course.state_jacobians[0], course.torque_jacobians[0]
    n = state.size
    seen = np.asarray(predictor.sensor(state, predictor.parameters)[1])[:, 0]
    linear = LinearPlant(A=A, B=B, row=seen, late=late, sample_time=dt)

    # Plant: state z and the torques u[k-1], ..., u[k-late-1].
    P, Pu = np.zeros((n + late + 1, n + late + 1)), np.zeros((n + late + 1, 1))
    P[:n, :n], P[:n, n + late] = A, B[:, 1]
    if late:
        P[:n, n + late - 1] = B[:, 0]
    else:
        Pu[:n, 0] = B[:, 0]
    P[n + 1 :, n:-1] = np.eye(late)
    Pu[n, 0] = 1.0
    plant = control.ss(P, Pu, np.append(seen, np.zeros(late + 1))[None, :], 0, dt)

    variance, torque_noise, drift = controller.estimator.levels[:3]
    kick = dt / predictor.model.inertia * torque_noise
    gain = filter_gain(linear, variance=variance, kick=kick, drift=drift)
    weights = controller._rate_weight, controller._terminal_weight
    acting, _ = law(linear, controller.horizon, *weights)
    return _assessed(plant, control.ss(*feedback(linear, gain, acting), dt), torque)


def _holding(controller: Controller, angle: float, velocity: float) -> tuple[float, Array]:
    """The drive output torque that keeps a velocity, by Newton's method, and the state with settled effect states."""
    predictor = controller.estimator.predictor
    torque = 0.0
    for _ in range(30):
        state = beginning(predictor.model, angle=angle, velocity=velocity, torque=torque)
        settled = np.tile(torque, 2)
        off = predictor.look_ahead(state, settled, 0.0).states[1, 1] - velocity
        nudge = 1e-4
        moved = beginning(predictor.model, angle=angle, velocity=velocity, torque=torque + nudge)
        slope = (predictor.look_ahead(moved, settled + nudge, 0.0).states[1, 1] - velocity - off) / nudge
        if not np.isfinite(off) or slope == 0.0:
            break
        torque -= off / slope
        if abs(off / slope) < 1e-10:
            return torque, beginning(predictor.model, angle=angle, velocity=velocity, torque=torque)
    raise BadParameter(f"No torque keeps the load at {angle:g} rad and {velocity:g} rad/s.")


def _assessed(plant: Any, feedback: Any, torque: float) -> LoopAnalysis:
    """Margins by python-control on a frequency grid; its polynomial method is inaccurate with dead times."""
    import control

    dt = plant.dt
    gain = -plant * feedback
    sensitivity, complementary = control.feedback(1, gain), control.feedback(gain, 1)
    frequencies = np.geomspace(0.5e-4, 0.5, _POINTS) / dt
    at = np.exp(2j * np.pi * frequencies * dt)
    seen = control.frd(np.asarray(gain(at)), 2 * np.pi * frequencies)
    gains, phases, _, _, crossings, _ = control.stability_margins(seen, returnall=True)
    order = np.argsort(crossings)
    phase, crossover = (float(values[order[-1]]) if order.size else np.nan for values in (phases, crossings))
    return LoopAnalysis(
        plant=plant,
        controller=feedback,
        gain=gain,
        sensitivity=sensitivity,
        complementary=complementary,
        gain_margin=float(np.min(gains[gains > 1.0], initial=np.inf)),
        phase_margin=phase,
        crossover=crossover / (2 * np.pi),
        delay_margin=float(np.min(np.radians(np.mod(phases, 360.0)) / crossings, initial=np.inf)),
        peak_sensitivity=float(np.max(np.abs(np.asarray(sensitivity(at))))),
        bandwidth=_last_above(frequencies, np.abs(np.asarray(complementary(at))), float(np.sqrt(0.5))),
        torque=torque,
    )


def _last_above(frequencies: Array, magnitude: Array, level: float) -> float:
    """Highest frequency at which a magnitude falls below a level [Hz], log-log interpolated; nan if there is none."""
    above = np.flatnonzero((magnitude[:-1] >= level) & (magnitude[1:] < level))
    if not above.size:
        return float("nan")
    i = above[-1]
    share = np.log(magnitude[i] / level) / np.log(magnitude[i] / magnitude[i + 1])
    return float(frequencies[i] * (frequencies[i + 1] / frequencies[i]) ** share)
