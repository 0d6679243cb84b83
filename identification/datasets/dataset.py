"""A data set with its predefined split into estimation and holdout data."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification.errors import MalformedLog
from identification.log import Log, Source
from identification.recording import Array, Recording
from plant.errors import BadParameter
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """Estimation data, holdout data, and the base model of a diagnosis.

    Attributes:
        estimation, holdout: the two parts; `holdout` is None if the data set has no split.
        base: the model to start from.
        fixed: names of the base's parameters that this machine does not have.
        inverse: whether the torque follows the motion, so that it is to be predicted from it.
        notes: publication, peculiarities, and published figures for comparison.
    """

    estimation: Log
    holdout: Log | None
    base: ServoModel
    fixed: tuple[str, ...] = ()
    inverse: bool | None = None
    notes: tuple[str, ...] = ()


def files_in(data: Path | str | Sequence[Path | str], pattern: str) -> list[Path]:
    """The files of a folder that match a pattern, or the given files, in the order of their names."""
    if isinstance(data, str | Path):
        folder = Path(data)
        if not folder.exists():
            raise BadParameter(f"{folder} does not exist; --data names the folder that holds the data set's files.")
        found = sorted(folder.glob(pattern)) if folder.is_dir() else [folder]
        if not found:
            raise MalformedLog(f"{folder} holds no {pattern} file, which this data set consists of.")
        return found
    return sorted(Path(file) for file in data)


def source(file: Path) -> Source:
    """Name and hash of a file."""
    return Source(file=file.name, sha256=hashlib.sha256(file.read_bytes()).hexdigest())


def arrays_of(file: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Named arrays of a MAT (v5) or NPZ file."""
    try:
        if file.suffix == ".mat":
            from scipy.io import loadmat

            content: Any = loadmat(file)
        else:
            content = np.load(file)
        missing = [name for name in names if name not in content]
        if missing:
            raise MalformedLog(f"{file.name} has no array '{missing[0]}', which this data set's files hold.")
        return {name: np.asarray(content[name]) for name in names}
    except MalformedLog:
        raise
    except Exception as error:  # a broken file may raise any exception of the parsers
        raise MalformedLog(
            f"{file.name} cannot be read as a {file.suffix} file ({type(error).__name__}), fetch it again."
        ) from None


def recording(
    *,
    label: str,
    number: int = 0,
    time: ArrayLike,
    command: ArrayLike,
    output: ArrayLike,
    servo_gain: ArrayLike = 0.0,
    command_limit: float = np.inf,
    valid: NDArray[np.bool_] | None = None,
    axis: str = "rotary",
    **others: Array,
) -> Recording:
    """One experiment in SI units, ready for the checks of every log."""
    clock = np.asarray(time, dtype=float)
    shapes = {clock.shape, np.shape(command), np.shape(output), *(np.shape(values) for values in others.values())}
    if len(shapes) > 1 or clock.ndim != 1:
        raise MalformedLog(f"{label}: the arrays differ in shape ({', '.join(map(str, shapes))}), fetch it again.")
    return Recording(
        label=label,
        number=number,
        time=clock,
        command=np.asarray(command, dtype=float),
        output=np.asarray(output, dtype=float),
        servo_gain=np.broadcast_to(np.asarray(servo_gain, dtype=float), clock.shape).copy(),
        valid=np.ones(clock.size, dtype=bool) if valid is None else valid,
        rows=np.arange(1, clock.size + 1),
        axis=axis,
        command_limit=command_limit,
        others=others,
    )
