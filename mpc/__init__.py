"""From a model to torques: estimator, controller, closed loop."""

from __future__ import annotations

from mpc.closed_loop import ClosedLoopResult, closed_loop
from mpc.controller import Control, Controller
from mpc.estimator import Estimator

__all__ = ["ClosedLoopResult", "Control", "Controller", "Estimator", "closed_loop"]
