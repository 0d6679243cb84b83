"""Figures 4 and 5 of the paper: model and machine under the same chirp; equation (5) compared with equation (4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.settings import need_positive, need_samples
from identification.fit import fit
from identification.log import Log
from plant.effects import CoulombFriction
from plant.errors import BadParameter
from plant.rig import Rig, RigRecord
from plant.servo import ServoModel
from plant.signals import chirp
from plant.simulation import simulate

PAPER = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
"""Equation (4) with the paper's numbers."""


@dataclass(frozen=True, kw_only=True)
class ChirpSettings:
    """The sweep and the machine.

    Attributes:
        title: for users.
        amplitude: of the output torque [N m].
        start, stop: frequencies [Hz]; the model is fitted to the reversed sweep.
        duration, sample_time: [s].
        preload: of each pinion [N m].
        steps: sample times at which eq. (5) is compared with eq. (4) [s].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    amplitude: float
    start: float
    stop: float
    duration: float
    sample_time: float
    preload: float
    steps: tuple[float, ...]
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that neither the signal nor the rig checks."""
        need_positive(self, "amplitude", "duration", "sample_time", "steps")
        need_samples(self.duration, min(self.sample_time, *self.steps))
        if any(abs(max(self.steps) / step - round(max(self.steps) / step)) > 1e-9 for step in self.steps):
            raise BadParameter("steps: each must divide the longest, so that all see the same torque.")
        self.machine()

    def machine(self) -> Rig:
        """The rig."""
        return Rig.paper_like(**self.rig)

    def torque(self, *, backwards: bool = False) -> Array:
        """(T,) output torque of the sweep [N m]."""
        ends = {"start": self.stop, "stop": self.start} if backwards else {"start": self.start, "stop": self.stop}
        return chirp(amplitude=self.amplitude, duration=self.duration, sample_time=self.sample_time, **ends)


@dataclass(frozen=True, kw_only=True, eq=False)
class ChirpResponse:
    """Responses (T,) [rad] to one chirp.

    Attributes:
        time, torque: (T,) [s], [N m].
        measured: of the rig, by its encoder.
        paper: of eq. (4) with the paper's numbers.
        found: of eq. (4) with parameters fitted to another sweep.
        model: those parameters.
        rubbing: of eq. (4) plus dry friction, fitted in the same way.
        friction: that dry friction [N m].
        contact_lost: whether a flank lost contact.
        steps: (K,) sample times of eq. (5) [s].
        difference: (K,) its largest difference from eq. (4) [rad].
    """

    time: Array
    torque: Array
    measured: Array
    paper: Array
    found: Array
    model: ServoModel
    rubbing: Array
    friction: float
    contact_lost: bool
    steps: Array
    difference: Array

    def fit_percent(self, simulated: Array) -> float:
        """100 (1 - |y - ys| / |y - mean y|): 100 is perfect, 0 no better than a constant."""
        spread = np.linalg.norm(self.measured - np.mean(self.measured))
        return float(100.0 * (1.0 - np.linalg.norm(self.measured - simulated) / spread))


def experiment(settings: ChirpSettings, seed: int) -> ChirpResponse:
    """Apply the chirp to the rig and to the models."""
    torque = settings.torque()
    played, other = _played(settings, torque, seed), _played(settings, settings.torque(backwards=True), seed + 1)
    log = Log.from_arrays(time=other.time, torque=settings.torque(backwards=True), angle=other.angle, label="sweep")
    model = fit(log, ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1)).model
    dry = fit(log, model.with_effect(CoulombFriction(torque=0.05))).model
    paper, found, rubbing = (
        simulate(each, command=torque, dt=settings.sample_time, substeps=2)[:-1, 0] for each in (PAPER, model, dry)
    )
    return ChirpResponse(
        time=played.time,
        torque=torque,
        measured=played.angle,
        paper=paper,
        found=found,
        model=model,
        rubbing=rubbing,
        friction=float(dry.values[-1]),
        contact_lost=bool(np.min(played.minimum_contact_torques) <= 0.0),
        steps=np.array(settings.steps),
        difference=np.array([_difference(settings, step) for step in settings.steps]),
    )


def _played(settings: ChirpSettings, torque: Array, seed: int) -> RigRecord:
    rig = settings.machine()
    pinions = rig.gears.pinion_torques(torque, settings.preload / rig.gears.null_vector[0])
    return rig.run(pinions, settings.sample_time, seed, start=rig.rest(torques=pinions[0]))


def _difference(settings: ChirpSettings, step: float) -> float:
    """Largest difference of eq. (5) at a sample time from eq. (4) [rad], with the torque held for the longest one."""
    hold = max(settings.steps)
    coarse = chirp(
        amplitude=settings.amplitude,
        start=settings.start,
        stop=settings.stop,
        duration=settings.duration,
        sample_time=hold,
    )
    torque = np.repeat(coarse, round(hold / step))
    exact = simulate(PAPER, command=torque, dt=step, substeps=4)[:, 0]
    return float(np.max(np.abs(simulate(PAPER, command=torque, dt=step, method="backward_difference")[:, 0] - exact)))


def run(settings: ChirpSettings, seed: int) -> Outcome:
    """Repeat figures 4 and 5, and report them."""
    found = experiment(settings, seed)
    of_paper, of_found = found.fit_percent(found.paper), found.fit_percent(found.found)
    of_rubbing, rig = found.fit_percent(found.rubbing), settings.machine()
    friction = rig.coulomb_friction + float(np.sum(rig.motor_coulomb * rig.motor_ratios))
    J, alpha, K = (float(value) for value in found.model.values)
    order = np.polyfit(np.log(found.steps), np.log(found.difference), 1)[0] if found.steps.size > 1 else float("nan")
    return Outcome(
        title=settings.title,
        results=(
            "With the same chirp, eq. (4) with the paper's J = 2, alpha = 0.5, K = 0.8 fits the test bench to "
            f"{of_paper:.1f} %. With numbers found on another sweep, J = {J:.3f}, alpha = {alpha:.3f}, K = {K:.3f}, it "
            f"fits to {of_found:.1f} %. The paper shows a picture and gives no number.",
            f"The remaining error is dry friction: with {found.friction:.3f} N m of it in the model the fit is "
            f"{of_rubbing:.2f} %. The simulated motors have {friction:.3f} N m. "
            f"Contact was {'lost' if found.contact_lost else 'never lost'}.",
            f"Equation (5) differs from eq. (4) by at most {', '.join(f'{d:.2g}' for d in found.difference)} rad at "
            f"sample times of {', '.join(f'{1e3 * s:g}' for s in found.steps)} ms. The error grows with the sample "
            f"time to the power {order:.2f}.",
        ),
        comparison=(
            ("J [kg m²]", "2", f"{J:.4f}"),
            ("alpha [N m]", "0.5", f"{alpha:.4f}"),
            ("K [N m s/rad]", "0.8", f"{K:.4f}"),
            ("fit of the model to the machine [%]", "“approximately close”", f"{of_found:.2f}"),
            ("fit with the paper's numbers [%]", "", f"{of_paper:.2f}"),
            ("fit with dry friction added [%]", "", f"{of_rubbing:.2f}"),
            *(
                (f"largest difference, eq. (5) and eq. (4), at {1e3 * s:g} ms [rad]", "", f"{d:.3g}")
                for s, d in zip(found.steps, found.difference, strict=True)
            ),
        ),
        found={
            "fit_percent_paper": of_paper,
            "fit_percent_found": of_found,
            "fit_percent_dry_friction": of_rubbing,
            "dry_friction": found.friction,
            "true_dry_friction": friction,
            "inertia": J,
            "gravity": alpha,
            "viscous_friction": K,
            "contact_lost": found.contact_lost,
            "equation5_steps": found.steps.tolist(),
            "equation5_differences": found.difference.tolist(),
            "equation5_order": float(order),
        },
        columns={
            "time": found.time,
            "torque": found.torque,
            "measured_angle": found.measured,
            "angle_paper_model": found.paper,
            "angle_found_model": found.found,
            "angle_dry_friction_model": found.rubbing,
        },
        pictures=(
            Picture(
                caption="Figure 5: responses to the chirp.",
                x="time [s]",
                y="angle [rad]",
                curves=[
                    Curve(name="rig", colour=MEASURED, x=found.time, y=found.measured),
                    Curve(name="eq. (4), the paper's numbers", colour=BEFORE, x=found.time, y=found.paper),
                    Curve(name="eq. (4), found", colour=AFTER, x=found.time, y=found.found),
                ],
            ),
            Picture(
                caption="What the models miss.",
                x="time [s]",
                y="test bench less model [rad]",
                curves=[
                    Curve(name="the paper's numbers", colour=BEFORE, x=found.time, y=found.measured - found.paper),
                    Curve(name="found", colour=AFTER, x=found.time, y=found.measured - found.found),
                    Curve(name="with dry friction", colour=SECOND, x=found.time, y=found.measured - found.rubbing),
                ],
            ),
            Picture(
                caption="Equation (5), the discrete model, against eq. (4).",
                x="sample time [s]",
                y="largest difference [rad]",
                curves=[Curve(name="eq. (5)", colour=SECOND, x=found.steps, y=found.difference, points=True)],
            ),
        ),
    )
