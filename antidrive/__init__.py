"""Identify the model of a geared servo, find the effects that it lacks, design its controller.

    import antidrive as ad

    found = ad.diagnose("log.csv")              # which physical effect does the model lack?
    print(found)
    found.report("report.html")
    found.extended.save("model.json")           # the model with that effect; ad.read_model("model.json").model is it
    gears = ad.GearTrain(pinion_teeth=(20, 20), output_teeth=161)
    controller = ad.Controller(found.extended.model, gears)
    loop = ad.closed_loop(controller, ad.Rig.paper_like(), 0.2, duration=1.0, seed=0)
    print(loop.tracking_rms, loop.minimum_contact_torque)

A log is a path, a DataFrame, arrays by name, or an `ad.Log`, which also takes other names and units; `ad.read_log`
reads a log.toml of `antidrive inspect`. Everything here
comes from a package of its own, `plant`, `allocation`, `identification`, `diagnosis` or `mpc`, which have more; each is
imported when its first name is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from antidrive.shadowed_packages import refuse_shadowing

if TYPE_CHECKING:
    from allocation import Allocator
    from antidrive.log_file import read_log
    from antidrive.model_comparison import compare
    from antidrive.prediction import predict
    from antidrive.version import VERSION as __version__
    from diagnosis import Diagnosis, diagnose
    from identification import Fit, Log, friction_test
    from identification import fit as identify
    from mpc import Controller, closed_loop
    from plant import GearTrain, Rig, ServoModel, catalogue, read_model, simulate, write_model

__all__ = [
    "Allocator",
    "Controller",
    "Diagnosis",
    "Fit",
    "GearTrain",
    "Log",
    "Rig",
    "ServoModel",
    "__version__",
    "catalogue",
    "closed_loop",
    "compare",
    "diagnose",
    "friction_test",
    "identify",
    "predict",
    "read_log",
    "read_model",
    "simulate",
    "write_model",
]

HOMES = {
    "Allocator": "allocation",
    "Controller": "mpc",
    "Diagnosis": "diagnosis",
    "Fit": "identification",
    "GearTrain": "plant",
    "Log": "identification",
    "Rig": "plant",
    "ServoModel": "plant",
    "catalogue": "plant",
    "closed_loop": "mpc",
    "compare": "antidrive.model_comparison",
    "diagnose": "diagnosis",
    "friction_test": "identification",
    "identify": "identification",
    "predict": "antidrive.prediction",
    "read_log": "antidrive.log_file",
    "read_model": "plant",
    "simulate": "plant",
    "write_model": "plant",
}
"""The package of each name."""

refuse_shadowing()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("antidrive.version").VERSION
    if name not in HOMES:
        raise AttributeError(f"antidrive has no {name!r}; it has {', '.join(HOMES)}.")
    value = getattr(importlib.import_module(HOMES[name]), "fit" if name == "identify" else name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
