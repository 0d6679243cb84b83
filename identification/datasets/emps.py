"""EMPS, the electro-mechanical positioning system: a cart on a ball screw under position control.

Janot, Gautier, Brunot: Data Set and Reference Models of EMPS. Workshop on Nonlinear System Identification Benchmarks,
Eindhoven, 2019. Two files of 24.8 s at 1 kHz; the second has additional force pulses, included in its drive voltage.
"""

from __future__ import annotations

from pathlib import Path

from identification.datasets.dataset import Dataset, arrays_of, recording, source
from identification.errors import MalformedLog
from identification.log import Log
from plant.servo import ServoModel

_NOTES = (
    "EMPS (Janot, Gautier, Brunot 2019): DATA_EMPS.mat is fitted, DATA_EMPS_PULSES.mat is held out.",
    "Published relative force error of the inverse model, estimation / held-out: symmetric Coulomb, viscous and offset "
    "4.08 / 5.98 %; asymmetric friction 3.11 % on estimation; inertia and viscous friction alone about 18 %.",
)


def read(files: list[Path]) -> Dataset:
    """Read both files; force = gtau * vir [N], position qm [m]."""
    by_name = {file.name: file for file in files}
    logs = []
    for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        if name not in by_name:
            raise MalformedLog(f"EMPS consists of DATA_EMPS.mat and DATA_EMPS_PULSES.mat, but {name} is not there.")
        logs.append(_log(by_name[name]))
    base = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=1.0, axis="linear")
    # a tight position loop, which its authors identify by the inverse model too
    return Dataset(estimation=logs[0], holdout=logs[1], base=base, inverse=True, notes=_NOTES)


def _log(file: Path) -> Log:
    data = {name: values.ravel() for name, values in arrays_of(file, ("t", "qg", "qm", "vir", "gtau")).items()}
    run = recording(
        label=file.name,
        time=data["t"],
        command=float(data["gtau"][0]) * data["vir"],
        output=data["qm"],
        axis="linear",
        reference=data["qg"].astype(float),
    )
    return Log.from_recordings([run], axis="linear", sources=[source(file)], command_unit="N")
