"""Model predictive control: estimator, controller, closed-loop simulation, loop analysis and code export."""

from __future__ import annotations

from mpc.analysis import LoopAnalysis, analyse_loop
from mpc.bode import bode_figure
from mpc.closed_loop import ClosedLoopResult, closed_loop
from mpc.control import Control
from mpc.controller import Controller
from mpc.estimator import Estimator
from mpc.export import TargetCode, export
from mpc.fmu import controller_fmu
from mpc.monte_carlo import MonteCarlo, Sweep, Trial, monte_carlo, sweep
from mpc.trajectory import Trajectory, minimum_copper_loss, time_optimal

__all__ = [
    "ClosedLoopResult",
    "Control",
    "Controller",
    "Estimator",
    "LoopAnalysis",
    "MonteCarlo",
    "Sweep",
    "TargetCode",
    "Trajectory",
    "Trial",
    "analyse_loop",
    "bode_figure",
    "closed_loop",
    "controller_fmu",
    "export",
    "minimum_copper_loss",
    "monte_carlo",
    "sweep",
    "time_optimal",
]


def __dir__() -> list[str]:
    return [*__all__]
