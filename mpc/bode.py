"""A picture of the loop: gain, sensitivities and phase over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mpc.analysis import LoopAnalysis

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def bode_figure(loop: LoopAnalysis) -> Figure:
    """Bode plot of an analysed loop, its numbers in the title."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    frequencies = np.geomspace(1e-3, 0.5, 600) / loop.gain.dt
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for name, system in (
        ("loop gain L", loop.gain),
        ("sensitivity S", loop.sensitivity),
        ("complementary T", loop.complementary),
    ):
        magnitude = np.abs(loop.response(system, frequencies))
        figure.add_trace(Scatter(x=frequencies, y=20 * np.log10(magnitude), name=name), row=1, col=1)
    phase = np.degrees(np.unwrap(np.angle(loop.response(loop.gain, frequencies))))
    figure.add_trace(Scatter(x=frequencies, y=phase, name="phase of L", showlegend=False), row=2, col=1)
    figure.add_vline(x=loop.crossover, line_dash="dot")
    figure.update_xaxes(type="log")
    figure.update_xaxes(title_text="frequency [Hz]", row=2, col=1)
    figure.update_yaxes(title_text="magnitude [dB]", row=1, col=1)
    figure.update_yaxes(title_text="phase [deg]", row=2, col=1)
    figure.update_layout(
        title_text=(
            f"crossover {loop.crossover:.2g} Hz, phase margin {loop.phase_margin:.0f} deg, gain margin "
            f"{loop.gain_margin:.2f}, peak sensitivity {loop.peak_sensitivity:.2f}, bandwidth {loop.bandwidth:.2g} Hz"
        )
    )
    return figure
