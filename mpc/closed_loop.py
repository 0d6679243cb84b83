"""The controller on the rig: the loop is closed on the machine that the model only approximates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation import least_effort
from mpc.controller import Controller
from plant.effects.parameter import Axis
from plant.errors import BadParameter
from plant.result_display import Presented
from plant.rig import Rig
from plant.units import axis_quantities

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopResult(Presented):
    """What happened over T samples; on a linear axis positions [m] in place of angles, and forces [N].

    Attributes:
        time: (T,) [s].
        reference: (T,) wanted load angle [rad].
        angle: (T,) true load angle [rad].
        measured_angle: (T,) as the encoder showed it [rad].
        velocity: (T,) true load velocity [rad/s].
        torques: (T, m) pinion torques [N m].
        disturbance: (T,) torque that the controller thinks the model misses [N m].
        margin: (T,) margin that the controller predicted [N m], seen from the pinion.
        flank_torques: (T, m) least torque of each required flank during each sample on the rig [N m], follower side;
            positive: contact was never lost.
        status: one for each sample.
        axis: of the machine.
        tracking_rms: root mean square of angle less reference [rad].
        least_flank_torque: the least of `flank_torques` [N m]: the preload margin that was really left.
        heat: mean of xi1^2 + xi2^2 [N^2 m^2].
    """

    time: Array
    reference: Array
    angle: Array
    measured_angle: Array
    velocity: Array
    torques: Array
    disturbance: Array
    margin: Array
    flank_torques: Array
    status: tuple[str, ...]
    axis: Axis = "rotary"

    @property
    def tracking_rms(self) -> float:
        """Root mean square of angle less reference [rad]."""
        return float(np.sqrt(np.mean((self.angle - self.reference) ** 2)))

    @property
    def least_flank_torque(self) -> float:
        """The least torque of any required flank on the rig [N m], follower side."""
        return float(np.min(self.flank_torques))

    @property
    def heat(self) -> float:
        """Mean of xi1^2 + xi2^2 [N^2 m^2], to which the Joule heat is proportional."""
        return float(np.mean(np.sum(self.torques**2, axis=1)))

    @property
    def degraded(self) -> int:
        """Number of samples whose status was not "optimal"."""
        return sum(status != "optimal" for status in self.status)

    def __repr__(self) -> str:
        """How long it was, and what came of it, in one line."""
        _, length, _, newton = axis_quantities(self.axis)
        duration = f"{self.time.size} samples to {self.time[-1]:.4g} s"
        found = f"tracking error {self.tracking_rms:.3g} {length} rms"
        contact = f"minimum contact torque {self.least_flank_torque:.3g} {newton}"
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
    """Run a controller on the rig, from rest at the reference's first angle, the teeth pressed by the least preload.

    Args:
        controller: it forgets first what it did before.
        rig: the machine.
        reference: wanted load angle [rad]: a function of time (M,) [s], or the samples, the last of them held.
        duration: [s].
        seed: of the encoder's noise.
        disturbance: torque on the load that nobody told the controller [N m], a number or (T,).
        after_sample: called after each, for those who want to know how far it is.

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
        flanks[k] = state.least_flank_torques
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
        flank_torques=flanks,
        status=tuple(status),
        axis=controller.model.axis,
    )
