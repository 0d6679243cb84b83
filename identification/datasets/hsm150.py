"""HSM150: two servo motors on one shaft; one torque step per file.

Malik, HSM150 identification data. 20 s at 1 kHz; the catalogue gives J = 1.2e-4 kg m^2 and B = 7.03e-5 N m s/rad.
"""

from __future__ import annotations

from pathlib import Path

from identification.datasets.dataset import Dataset, arrays_of, recording, source
from identification.errors import MalformedLog
from identification.log import Log
from plant.servo import ServoModel

_NOTES = (
    "HSM150: the last file by name is held out, the others are fitted.",
    "Catalogue: J = 1.2e-4 kg m^2 for one motor, B = 7.03e-5 N m s/rad.",
    "One torque step a file: friction over speed shows at two speeds a file, and nothing reverses, so Coulomb friction "
    "cannot be told from an offset of the torque within one direction.",
    "The input torque is the one that was commanded. What the motor's current made of it differs by up to 31 % in the "
    "mean, and is noisy; only with that do the runs agree in inertia and viscous friction.",
)


def read(files: list[Path]) -> Dataset:
    """Read all files; the shaft has no gravity."""
    if len(files) < 2:
        raise MalformedLog("HSM150 needs at least two files, because one of them is held out.")
    logs = []
    for part in (files[:-1], files[-1:]):
        runs = []
        for number, file in enumerate(part):
            table = arrays_of(file, ("data",))["data"]
            if table.ndim != 2 or table.shape[1] != 7:
                raise MalformedLog(f"{file.name}: 'data' has shape {table.shape}, expected seven columns.")
            runs.append(
                recording(label=file.name, number=number, time=table[:, 0], command=table[:, 4], output=table[:, 2])
            )
        logs.append(Log.from_recordings(runs, axis="rotary", sources=[source(f) for f in part], command_unit="N m"))
    base = ServoModel(inertia=1e-3, gravity=0.0, viscous_friction=1e-4)
    return Dataset(estimation=logs[0], holdout=logs[1], base=base, fixed=("gravity",), notes=_NOTES)
