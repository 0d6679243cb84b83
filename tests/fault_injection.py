"""A controller on a servo to which things happen: readings, references, estimates, solvers and drives that fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpc import Control, Controller
from plant import GearTrain, ServoModel, sample_step

Array = NDArray[np.float64]
GEARS = GearTrain.paper()
MISHAPS = (
    "no reading",
    "infinite reading",
    "wild reading",
    "stale reading",
    "no reference",
    "absurd reference",
    "wild reference",
    "push",
    "moved by hand",
    "estimate diverges",
    "covariance spoilt",
    "solver stops early",
    "memory spoilt",
    "drive 1 dead",
    "drive 2 dead",
)
CALM = 100
"""Samples without a mishap at least, before the next one."""

PATIENCE = 4000
"""Samples in which the controller must have come back: a load that is thrown takes seconds to brake."""

BRAKES = 0.5
"""Acceleration that is there in any case [rad/s^2]."""

PUSHED = 0.5
"""Torque that an estimate still believes in, where there is none [N m]."""

BACK = 1e-3
"""Error at which it has come back [rad]."""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One sample: what was fed and handed out, and the mishap if there was one."""

    mishap: str
    reading: float
    reference: Array
    control: Control
    error: float  # true angle less reference [rad]
    calm: int  # samples since the last mishap
    settled: int  # samples since the error was last above a third of `BACK`
    thrown: bool  # beyond a limit of angle or speed, or too fast to stop before one


class Patient:
    """A servo that moves exactly as the model of its controller says, unless something happens to it."""

    def __init__(self, model: ServoModel, controller: Controller, seed: int) -> None:
        self.controller, self.rng = controller, np.random.default_rng(seed)
        self._model, self._step = model, sample_step(model, substeps=2)
        self._state, self._last, self._reading = np.zeros(len(model.states)), 0.0, 0.0
        self._wanted, self._settled = 0.0, 0

    def sample(self, mishap: str, calm: int) -> Sample:
        rng, controller = self.rng, self.controller
        if calm == 0 and mishap == "moved by hand":
            self._state[0] += rng.normal()
            self._state[1] = 2.0 * rng.normal()  # 2.1 rad/s is the fastest that the motors give
        if calm == 1:  # from here on it is to come back
            self._wanted = float(np.clip(self._state[0] + 0.02 * rng.normal(), *controller.angle_limits))
        reading = self._reading if mishap == "stale reading" else float(self._state[0] + 1e-5 * rng.normal())
        self._reading = reading
        match mishap:
            case "no reading":
                reading = np.nan
            case "infinite reading":
                reading = float(rng.choice([np.inf, -np.inf, 1e300, -1e200]))
            case "wild reading":
                reading += float(10 ** rng.uniform(-3, 6) * rng.choice([-1, 1]))
            case "estimate diverges":
                controller.estimator.state = 10 ** rng.uniform(0, 308, len(controller.estimator.predictor.model.states))
                controller.estimator.disturbance = float(rng.choice([0.0, 1e6, np.nan]))
            case "covariance spoilt":
                controller.estimator.kalman[3 + len(self._state) :] = rng.choice([np.nan, -1.0, 1e200, 0.0])
            case "memory spoilt":
                name = str(rng.choice(["plan", "path", "history", "load", "bounds", "watched"]))
                controller._arrays[name][:] = rng.choice([np.nan, np.inf, 1e200, -7.0])
        reference = self._reference(mishap)
        rounds = controller._machine_code.layout.rounds
        if mishap == "solver stops early":
            controller._machine_code.layout.rounds = controller._interpreted.program.rounds = 0
        control = controller.step(reading, reference)
        controller._machine_code.layout.rounds = controller._interpreted.program.rounds = rounds
        error, (angle, speed) = float(self._state[0] - self._wanted), self._state[:2].tolist()
        low, high = controller.angle_limits
        stopped = angle + speed * abs(speed) / (2 * BRAKES)
        thrown = not (low < angle < high and low < stopped < high and abs(speed) < controller.speed_limit)
        self._settled = self._settled + 1 if abs(error) <= BACK / 3 else 0
        self._advance(mishap, control.torques)
        return Sample(
            mishap=mishap,
            reading=reading,
            reference=reference,
            control=control,
            error=error,
            calm=calm,
            settled=self._settled,
            thrown=thrown,
        )

    def _reference(self, mishap: str) -> Array:
        ahead = np.full(self.controller.horizon + 1, self._wanted)
        match mishap:
            case "no reference":
                ahead[self.rng.integers(0, ahead.size)] = np.nan
            case "absurd reference":
                ahead[:] = self.rng.choice([1e300, -1e200, 1e18])
            case "wild reference":
                ahead = self.rng.normal(size=ahead.size) * 10 ** self.rng.uniform(-3, 3)
        return ahead if self.rng.random() < 0.7 else np.asarray(ahead[0])

    def _advance(self, mishap: str, torques: Array) -> None:
        applied = torques.copy()
        if mishap.startswith("drive"):
            applied[int(mishap[6]) - 1] = 0.0
        torque = float(GEARS.output_torque(applied)) + (3.0 if mishap == "push" else 0.0)
        inputs = np.array([torque, self._last, 0.0, np.inf, 0.0, self.controller.sample_time, 0.0, 0.0])
        self._state = np.asarray(self._step(self._state, inputs, self._model.values))[:, 0]
        self._last = torque


def life(model: ServoModel, controller: Controller, seed: int) -> Iterator[Sample]:
    """Mishaps without end, each of 1 to 30 samples and time to come back behind it, all of them in turn."""
    patient = Patient(model, controller, seed)
    while True:
        for mishap in patient.rng.permutation(MISHAPS):
            for _ in range(int(patient.rng.integers(1, 31))):
                yield patient.sample(str(mishap), 0)
            calm, back = 0, False
            while calm < CALM or (not back and calm < PATIENCE):
                calm += 1
                sample = patient.sample("", calm)
                back = back or (abs(sample.error) < BACK and sample.control.status == "optimal")
                yield sample


def broken_promises(controller: Controller, sample: Sample) -> list[str]:
    """What a sample is not as it must be: bounds to the last bit over the whole horizon, an honest status, recovery."""
    control, xi = sample.control, sample.control.predicted_torques
    wrong = []
    if not (np.all(xi[:, 0] >= controller.min_torque) and np.all(xi[:, 1] <= -controller.min_torque)):
        wrong.append("a drive is not unidirectional")
    if not np.all(np.abs(xi) <= controller.max_torque):
        wrong.append("a torque is beyond its limit")
    if not np.array_equal(control.torques, xi[0]) or not np.isfinite(control.margin):
        wrong.append("what is handed out is not what was planned")
    if control.status != "optimal" and not control.status.startswith("degraded: "):
        wrong.append(f"status {control.status!r}")
    if control.status == "optimal":
        if not (np.isfinite(sample.reading) and np.all(np.isfinite(sample.reference))):
            wrong.append("something was not a number, and nothing is said")
        if not control.residual <= 1e-6:
            wrong.append("called optimal, but not certified")
    thrown = sample.thrown or abs(control.disturbance) > PUSHED  # or takes itself for it
    late = thrown and control.status == "degraded: a limit of angle or speed cannot be kept"
    period = 1.0 / (controller.bandwidth * controller.sample_time)  # over which that status looks back
    astray = sample.calm <= 3 * CALM or sample.settled <= period  # and the loop says so
    late = late or (astray and control.status.endswith("the load does not follow the reference"))
    if sample.calm > 20 and control.status != "optimal" and not late:
        wrong.append(f"not recovered: {control.status}")
    if sample.calm == PATIENCE:
        wrong.append(f"lost, and off by {sample.error:.2g} rad")
    return wrong
