"""Payload change: a load is picked up or put down."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from plant.effects.effect import Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter

if TYPE_CHECKING:
    from plant.servo import ServoModel

_TIMES = 40
_SEEN = 0.1  # fraction of the travel that each of the two loads has to cover
_APART = (
    0.3,
    0.1,
    0.03,
)  # seconds between similar instants, by stage; a servo reverses in a few of the first
_INSTANTS = (8, 3, 3)  # number of instants on each side, by stage


@dataclass(frozen=True, kw_only=True)
class PayloadChange(Effect):
    """Inertia and gravity that change at an instant.

    The change is spread over one integration step around its instant, so that a derivative by the instant exists.
    """

    name = "payload_change"
    title = "payload change"
    stage = Stage.LOAD
    needs_angle = True
    equation = r"J \leftarrow J + \Delta J,\; \alpha \leftarrow \alpha + \Delta\alpha \quad (t > t^*)"
    signature = "an error that begins at a time"
    confused_with = ("friction_drift",)
    multimodal = True
    clocked = True
    axes = ("rotary",)

    time: float = parameter("s", "instant t* on the log's clock", instant=True)
    inertia: float = parameter("{torque} s^2/{angle}", "change of the inertia")
    gravity: float = parameter("{torque}", "change of the gravity torque")

    def _after(self, at: Moment) -> Expression:
        return ca.fmax(ca.fmin((at.time - self.time) / ca.fmax(at.step, 1e-15) + 0.5, 1), 0)

    def added_inertia(self, at: Moment) -> Expression:
        """The change, from the instant on."""
        return self.inertia * self._after(at)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Gravity of the change."""
        return -self.gravity * self._after(at) * ca.cos(at.angle)

    def plausible(self, log: Covered) -> bool:
        """Whether the load moves before and after the instant; a change at the start may be an initial transient."""
        return bool(min(log.travelled(self.time)) > _SEEN * log.travel)

    def similar_shapes(self, stage: int) -> tuple[PayloadChange, ...]:
        """Instants before and after; the likelihood has separate peaks for the motions in between."""
        steps = _APART[stage] * np.arange(1, _INSTANTS[stage] + 1)
        return tuple(replace(self, time=float(self.time + step)) for step in (*-steps[::-1], *steps))

    def without_clock(self, rest: ServoModel, end: float | None) -> ServoModel:
        """The payload as part of the load, since its instant lies within the log."""
        return rest.with_payload(inertia=self.inertia, gravity=self.gravity)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Acceleration and gravity after each of many instants."""
        for instant in np.quantile(motion.time, np.linspace(0.03, 0.97, _TIMES)):
            after = motion.time >= instant
            columns = -np.column_stack((motion.acceleration * after, np.cos(motion.angle) * after))
            yield Regressors(
                columns=columns,
                start=lambda c, t=instant: cls(  # type: ignore[misc]
                    time=float(t), inertia=max(float(c[0]), -0.7 * motion.inertia), gravity=float(c[1])
                ),
                searched=_TIMES,
            )
