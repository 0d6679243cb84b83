"""Compliance: a spring between motor and load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import (
    POSITIVE,
    Array,
    Covered,
    Effect,
    Expression,
    Motion,
    Regressors,
    Stage,
    State,
    fastest_swing,
    parameter,
    within,
)

_MOST_DAMPED = 0.3  # damping ratio of a drivetrain: four times that of rubber


@dataclass(frozen=True, kw_only=True)
class Compliance(Effect):
    """Two masses on a torsional spring and a damper; the measured angle is the load's.

    With J_r = J_m J_l / J, the frequency of both ends free is sqrt(k / J_r) and the damping d / (2 frequency J_r).
    """

    name = "compliance"
    title = "compliance"
    stage = Stage.DRIVETRAIN
    equation = r"\tau_l = k(\theta - x) + d(\dot\theta - \dot x)"
    signature = "ringing; an anti-resonance and a resonance"
    confused_with = ("backlash", "input_delay", "actuator_lag")
    multimodal = True
    states = (State.ANGLE, State.VELOCITY)
    flexible = True

    frequency: float = parameter("rad/s", "resonance", lower=POSITIVE, swing=True)
    damping: float = parameter("-", "damping ratio of the resonance", lower=1e-4, upper=2.0)
    motor_share: float = parameter("-", "share of the inertia on the motor's side", lower=0.02, upper=0.98)

    def step_within(self, sample_time: float) -> float:
        """One radian of the fastest oscillation that a fit may try, and of the effect's own resonance."""
        return 1.0 / max(fastest_swing(sample_time), self.frequency)

    def share(self) -> Expression:
        """The motor's share."""
        return self.motor_share

    def coupling(self, twist: Expression, rate: Expression, inertia: Expression) -> Expression:
        """Spring and damper."""
        reduced = self.motor_share * (1.0 - self.motor_share) * inertia
        return reduced * self.frequency * (self.frequency * twist + 2.0 * self.damping * rate)

    def loaded(self, before: float, after: float) -> Compliance:
        """The motor, the spring and the damper do not change."""
        share = within(self.motor_share * before / after, Compliance, "motor_share")
        slower = float(np.sqrt((1.0 - self.motor_share) / (1.0 - share)))
        return Compliance(
            frequency=within(self.frequency * slower, Compliance, "frequency"),
            damping=within(self.damping * slower, Compliance, "damping"),
            motor_share=share,
        )

    def plausible(self, log: Covered) -> bool:
        """Whether it oscillates: a spring with more damping is a filter.

        Even rubber couplings have damping ratios D of 0.04 to 0.07 only (as damping energy ratios 4 pi D of 0.45 to
        0.90; Martyr and Plint 2007, table 9.2).
        """
        return self.damping < _MOST_DAMPED

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The command filtered by a resonance less the command: effect of a motor torque on the load (spring c s + k).

        From motor torque to load angle a two-mass system is a rigid body after the low pass (2 D w s + w^2) / (s^2 + 2
        D w s + w^2), for any shares of the masses.
        """
        dampings = (0.03, 0.2)
        bound = fastest_swing(motion.sample_time)
        fastest = min(1.5 / motion.sample_time, 0.8 * bound)
        frequencies = np.geomspace(0.02 * fastest, fastest, 12)
        torque = motion.arriving(motion.torque)
        for frequency in frequencies:
            for damping in dampings:
                behind = motion.by_run(
                    lambda rows, w=frequency, d=damping: _behind(torque[rows], w, d, motion.sample_time)  # type: ignore[misc]
                )
                yield Regressors(
                    columns=(behind - torque)[:, None],
                    positive=(True,),
                    start=lambda c, w=frequency, d=damping: cls(  # type: ignore[misc]
                        frequency=min(float(w / np.sqrt(np.clip(c[0], 0.25, 4.0))), bound),
                        damping=d,
                        motor_share=0.3,
                    ),
                    searched=frequencies.size * len(dampings),
                )


def _behind(torque: Array, frequency: float, damping: float, dt: float) -> Array:
    """(T,) mean over each sample of a held torque filtered by the resonance [N m]."""
    from scipy import signal

    slope, level = 2.0 * damping * frequency, frequency**2
    integral = (
        np.array([slope, level]),
        np.array([1.0, slope, level, 0.0]),
    )  # a further integration gives means instead of samples
    numerator, denominator, _ = signal.cont2discrete(integral, dt)
    summed = signal.lfilter(numerator.ravel(), denominator, torque - torque[0])
    return np.asarray(torque[0] + np.diff(np.append(summed, summed[-1])) / dt)
