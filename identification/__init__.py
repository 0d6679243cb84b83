"""Identification: parameters with their uncertainty from a measured log."""

from __future__ import annotations

from identification.errors import MalformedLog, MissingColumns, Unidentifiable, UnusableLog
from identification.fit import base_model, fit
from identification.fit_result import Fit, FittedParameter, fit_report, fit_to_dict
from identification.friction_test import FrictionTest, friction_test
from identification.inverse import torque_error
from identification.inverse_log import inverse_log
from identification.log import Log
from identification.log_like import log_of
from identification.lost_motion import LostMotion, lost_motion
from identification.run import Run
from identification.simulation import free_simulation

__all__ = [
    "Fit",
    "FittedParameter",
    "FrictionTest",
    "Log",
    "LostMotion",
    "MalformedLog",
    "MissingColumns",
    "Run",
    "Unidentifiable",
    "UnusableLog",
    "base_model",
    "fit",
    "fit_report",
    "fit_to_dict",
    "free_simulation",
    "friction_test",
    "inverse_log",
    "log_of",
    "lost_motion",
    "torque_error",
]


def __dir__() -> list[str]:
    return [*__all__]
