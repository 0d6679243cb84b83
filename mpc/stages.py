"""The stages of a step as CasADi functions, used by the machine code and by the Python form of the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from mpc.encoder_faults import watch
from mpc.estimator import Estimator
from mpc.feed_forward import demand, ease
from mpc.friction import learn, rub
from mpc.governor import Governor
from mpc.prepared import prepared
from mpc.preview import preview
from mpc.riccati import backward, forward, slope
from mpc.soft_limits import corridor, enter
from mpc.stage_allocation import allocation, reach
from mpc.time_optimal_law import early, followable, governed, hurry, jump
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class Stages:
    """The stages of one controller.

    Attributes:
        friction: `mpc.friction.rub`, `mpc.friction.learn` and `mpc.feed_forward.demand` of its model.
        watch: encoder fault detection, `mpc.encoder_faults.watch`.
        every: all stages.
    """

    friction: tuple[Any, Any, Any]
    watch: Any
    every: tuple[Any, ...]

    @classmethod
    def of(cls, model: ServoModel, estimator: Estimator, governor: Governor, rows: int) -> Self:
        """The stages for a model with friction but without the drive, and a program with `rows` intervals per stage."""
        motors, n = estimator.motors is not None, len(model.states)
        friction = rub(model), learn(model, motors), demand(model)
        watching = watch(estimator.predictor, motors)
        filters = (estimator.predictor.along.function, watching, *estimator.functions, *friction)
        govern = prepared(governed(governor.soft is not None)).function
        aims = (ease(), preview(), jump(), hurry(), early(), followable(), govern, enter(), corridor())
        sweeps = (backward(n, rows), forward(n), slope(n, rows))
        allocations = (prepared(reach()).function, prepared(allocation()).function)
        return cls(friction=friction, watch=watching, every=(*filters, *aims, *sweeps, *allocations))
