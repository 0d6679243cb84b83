"""From a model to torques: estimator, controller, closed loop, and what the loop is worth."""

from __future__ import annotations

from mpc.analysis import LoopAnalysis, analyse_loop
from mpc.bode import bode_figure
from mpc.closed_loop import ClosedLoopResult, closed_loop
from mpc.controller import Control, Controller
from mpc.estimator import Estimator
from mpc.trajectory import Trajectory, minimum_heat, time_optimal

__all__ = [
    "ClosedLoopResult",
    "Control",
    "Controller",
    "Estimator",
    "LoopAnalysis",
    "Trajectory",
    "analyse_loop",
    "bode_figure",
    "closed_loop",
    "minimum_heat",
    "time_optimal",
]
