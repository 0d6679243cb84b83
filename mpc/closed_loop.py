"""Closed-loop simulation: the controller on the test bench, which its model only approximates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation import least_effort
from mpc.controller import Controller
from plant.effects.parameter import Axis
from plant.errors import BadParameter
from plant.renamed import Renamed
from plant.result_display import Drawn
from plant.rig import Rig
from plant.units import axis_quantities

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopResult(Drawn):
    """Signals of a closed loop over T samples; on a linear axis positions [m] instead of angles, and forces [N].

    Attributes:
        time: (T,) [s].
        reference: (T,) wanted load angle [rad].
        angle: (T,) true load angle [rad].
        measured_angle: (T,) measured by the encoder [rad].
        velocity: (T,) true load velocity [rad/s].
        torques: (T, m) pinion torques [N m].
        disturbance: (T,) disturbance torque estimated by the controller [N m].
        margin: (T,) margin predicted by the controller [N m], seen from the pinion.
        contact_torques: (T, m) minimum contact torque of each drive during each sample on the test bench [N m], at the
            output gear; positive: contact was never lost.
        status: (T,) status of each sample.
        axis: of the machine.
        tracking_rms: root mean square of angle minus reference [rad].
        minimum_contact_torque: minimum contact torque, the least of `contact_torques` [N m].
        copper_loss: mean of xi1^2 + xi2^2 [N^2 m^2].
    """

    time: Array
    reference: Array
    angle: Array
    measured_angle: Array
    velocity: Array
    torques: Array
    disturbance: Array
    margin: Array
    contact_torques: Array
    status: tuple[str, ...]
    axis: Axis = "rotary"

    @property
    def tracking_rms(self) -> float:
        """Root mean square of angle minus reference [rad]."""
        return float(np.sqrt(np.mean((self.angle - self.reference) ** 2)))

    @property
    def minimum_contact_torque(self) -> float:
        """Minimum contact torque on the test bench [N m], at the output gear."""
        return float(np.min(self.contact_torques))

    least_flank_torque = Renamed("minimum_contact_torque")

    @property
    def copper_loss(self) -> float:
        """Mean of xi1^2 + xi2^2 [N^2 m^2], proportional to the Joule heat."""
        return float(np.mean(np.sum(self.torques**2, axis=1)))

    @property
    def degraded(self) -> int:
        """Number of samples whose status was not "optimal"."""
        return sum(status != "optimal" for status in self.status)

    def __repr__(self) -> str:
        """Duration, tracking error and minimum contact torque, in one line."""
        _, length, _, newton = axis_quantities(self.axis)
        duration = f"{self.time.size} samples to {self.time[-1]:.4g} s"
        found = f"tracking error {self.tracking_rms:.3g} {length} rms"
        contact = f"minimum contact torque {self.minimum_contact_torque:.3g} {newton}"
        return f"ClosedLoopResult({duration}; {found}, {contact}, {self.degraded} degraded)"


def closed_loop(
    controller: Controller,
    rig: Rig,
    reference: Callable[[Array], ArrayLike] | ArrayLike,
    duration: float,
    seed: int,
    *,
    disturbance: ArrayLike = 0.0,
    after_sample: Callable[[], None] | None = None,
) -> ClosedLoopResult:
    """Run a controller on the test bench, from rest at the first angle of the reference, with the least preload.

    Args:
        controller: it is reset first.
        rig: the test bench.
        reference: wanted load angle [rad]: a function of time (M,) [s], or samples; the last one is held.
        duration: [s].
        seed: of the encoder noise.
        disturbance: torque on the load, unknown to the controller [N m], a number or (T,).
        after_sample: called after each sample, to show the progress.

    Raises:
        BadParameter: a duration below one sample, or a reference that is not finite.
    """
    controller.reset()
    dt, N = controller.sample_time, controller.horizon
    if not np.isfinite(duration) or duration < dt:
        raise BadParameter(f"The duration must be at least one sample of {dt:g} s, not {duration!r} s.")
    count = round(duration / dt)
    time = np.arange(count + N + 1, dtype=np.float64) * dt
    if callable(reference):
        wanted = np.broadcast_to(np.asarray(reference(time), dtype=np.float64), time.shape)
    else:
        samples = np.atleast_1d(np.asarray(reference, dtype=np.float64))
        wanted = samples[np.minimum(np.arange(time.size), samples.size - 1)]
    if not np.all(np.isfinite(wanted)):
        raise BadParameter("The reference of a closed loop must be finite throughout.")
    pushes = np.broadcast_to(np.asarray(disturbance, dtype=np.float64), (count,))
    rng = np.random.default_rng(seed)
    preloaded = least_effort(controller.bounds, 0.0) if controller.bounds.structure.drives > 1 else 0.0
    state = rig.rest(float(wanted[0]), preloaded)
    angle, velocity, measured, unknown, margin = (np.empty(count) for _ in range(5))
    torques, flanks = (np.empty((count, len(rig.drives))) for _ in range(2))
    status = []
    for k in range(count):
        angle[k], velocity[k], measured[k] = state.angle, state.velocity, rig.measure(state, rng)
        shown = None if controller.motor_resolution is None else rig.motor_angles(state)
        control = controller.step(measured[k], wanted[k : k + N + 1], shown)
        state = rig.advance(state, control.torques, dt, float(pushes[k]))
        torques[k], margin[k], unknown[k] = control.torques, control.margin, control.disturbance
        flanks[k] = state.minimum_contact_torques
        status.append(control.status)
        if after_sample is not None:
            after_sample()
    return ClosedLoopResult(
        time=time[:count],
        reference=wanted[:count].copy(),
        angle=angle,
        measured_angle=measured,
        velocity=velocity,
        torques=torques,
        disturbance=unknown,
        margin=margin,
        contact_torques=flanks,
        status=tuple(status),
        axis=controller.model.axis,
    )
