"""Bode plot of the loop: gain, sensitivities and phase over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mpc.analysis import LoopAnalysis
from plant.errors import BadParameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bode_figure(loop: LoopAnalysis) -> Figure:
    """Bode plot of an analysed loop, with its margins in the title. A notebook displays it.

    Raises:
        BadParameter: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise BadParameter("A picture needs matplotlib: pip install matplotlib.") from None
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    draw_bode(loop, figure.subplots(2, 1, sharex=True))
    return figure


def draw_bode(loop: LoopAnalysis, axes: Any) -> None:
    """Magnitudes and phase in two axes."""
    upper, lower = axes
    frequencies = loop.frequencies
    for name, system in (
        ("loop gain L", loop.gain),
        ("sensitivity S", loop.sensitivity),
        ("complementary T", loop.complementary),
    ):
        magnitude = np.abs(loop.response(system, frequencies))
        upper.semilogx(frequencies, 20 * np.log10(magnitude), label=name)
    phase = np.degrees(np.unwrap(np.angle(loop.response(loop.gain, frequencies))))
    lower.semilogx(frequencies, phase, label="phase of L")
    for ax in (upper, lower):
        ax.axvline(loop.crossover, linestyle=":", color="0.5")
        ax.grid(alpha=0.3)
    upper.set(ylabel="magnitude [dB]")
    upper.legend(frameon=False)
    lower.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
    upper.set_title(
        f"crossover {loop.crossover:.2g} Hz, phase margin {loop.phase_margin:.0f} deg, gain margin "
        f"{loop.gain_margin:.2f}, peak sensitivity {loop.peak_sensitivity:.2f}, bandwidth {loop.bandwidth:.2g} Hz",
        fontsize=10,
    )
