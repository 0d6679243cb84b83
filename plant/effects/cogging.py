"""Cogging: a torque that repeats with the angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.ndimage import median_filter

from plant.effects.effect import Array, Effect, Expression, Moment, Motion, Stage, Trace, parameter, within


@dataclass(frozen=True, kw_only=True)
class Cogging(Effect):
    """A torque ripple over the angle: poles passing slots, teeth in mesh, a screw's turn."""

    name = "cogging"
    title = "cogging"
    stage = Stage.LOAD
    equation = r"\tau_c = A \sin(n x + \varphi)"
    trace = "order lines over angle, constant in torque"
    confused_with = ("encoder_eccentricity", "gravity_offset")

    amplitude: float = parameter("{torque}", "amplitude A", lower=0.0)
    order: float = parameter("rad/{angle}", "periods per turn n", lower=0.0)
    phase: float = parameter("rad", "phase at angle zero")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The ripple."""
        return self.amplitude * ca.sin(self.order * at.angle + self.phase)

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Sine and cosine at the orders that would improve the fit most."""
        orders, searched = strongest_orders(motion)
        for order in orders:
            ripple = np.column_stack((np.sin(order * motion.angle), np.cos(order * motion.angle)))
            yield Trace(
                columns=ripple,
                start=lambda c, order=order: cls(  # type: ignore[misc]
                    amplitude=within(float(np.hypot(*c)), cls, "amplitude"),
                    order=order,
                    phase=float(np.arctan2(c[1], c[0])),
                ),
                searched=searched,
            )


_NEIGHBOURHOOD = 101  # orders, a quarter of a resolvable line each, whose median is the background of a peak


def strongest_orders(motion: Motion, count: int = 6) -> tuple[list[float], int]:
    """Peaks of the periodogram of the score over angle, and the number of orders looked at.

    An order must complete two periods within the travel, or it cannot be told from a trend; and a period must
    take more than four samples at typical speed, or it is not resolved.
    """
    travel = float(np.ptp(motion.angle))
    speed = float(np.quantile(np.abs(motion.velocity), 0.5))
    if travel <= 0.0 or speed <= 0.0:
        return [], 1
    lowest = 2.0 * np.pi * 2.0 / travel
    highest = min(2.0 * np.pi / (4.0 * speed * motion.sample_time), 4000.0 * lowest)
    if highest <= lowest:
        return [], 1
    orders = np.arange(lowest, highest, 2.0 * np.pi / travel / 4.0)
    power = _periodogram(motion.angle, motion.score, orders)
    # A low order moves the load further than a high one, so the background falls with the order: a line may stand out
    # of it without being among the highest.
    background = np.maximum(median_filter(power, size=_NEIGHBOURHOOD, mode="nearest"), 1e-300)
    chosen: list[float] = []
    for height in (power, power / background):
        found = 0
        for index in np.argsort(height)[::-1]:
            if all(abs(orders[index] - other) > 2.0 * np.pi / travel for other in chosen):
                chosen.append(float(orders[index]))
                found += 1
            if found == count:
                break
    return chosen, orders.size


def _periodogram(angle: Array, values: Array, orders: Array) -> Array:
    """Power of `values` at each order over `angle`, by binning the angle finely and transforming the bins."""
    step = 2.0 * np.pi / orders[-1] / 6.0
    bins = np.floor((angle - angle.min()) / step).astype(int)
    sums = np.bincount(bins, weights=values)
    length = int(2 ** np.ceil(np.log2(8 * sums.size)))
    spectrum = np.abs(np.fft.rfft(sums, length)) ** 2
    return np.asarray(np.interp(orders, 2.0 * np.pi * np.fft.rfftfreq(length, step), spectrum), dtype=float)
