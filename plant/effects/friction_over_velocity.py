"""Non-parametric friction: a smooth curve over velocity, and dry friction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np

from plant.effects.effect import Array, Effect, Expression, Moment, Motion, Regressors, parameter
from plant.effects.nonparametric_curve import Curve, CurveOverVelocity

if TYPE_CHECKING:
    from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class FrictionOverVelocity(CurveOverVelocity):
    """A curve over velocity plus dry friction: a curve alone would be steep at each reversal and has no stiction."""

    name = "friction_over_velocity"
    title = "friction over velocity"
    equation = r"\tau_u \in f(\dot x) - F\,\mathrm{sgn}(\dot x)"
    prior = np.pad(Curve.prior, (0, 1))
    prior[-1, -1] = 1.0

    dry: float = parameter("{torque}", "dry friction F", lower=0.0, default=0.0)

    @classmethod
    def beside(cls, model: ServoModel) -> bool:
        """Only without other dry friction in the model; otherwise it would replace it."""
        return super().beside(model) and not model.slides

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The same level in both directions."""
        return self.dry, self.dry

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """One column for each knot, and one against the motion."""
        for regressors in super().regressors(motion):
            columns = np.column_stack((regressors.columns, -motion.sign))
            yield replace(regressors, columns=columns, start=partial(_with_dry, regressors.start))


def _with_dry(start: Callable[[Array], Effect], coefficients: Array) -> Effect:
    curve = cast("FrictionOverVelocity", start(coefficients[:-1]))
    return replace(curve, dry=max(float(coefficients[-1]), 0.0))
