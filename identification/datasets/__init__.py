"""Known public data sets, read from a folder of the user; their files are not part of this package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType

from identification.datasets import bam, emps, hsm150, kscale, ur10e
from identification.datasets.dataset import Dataset, files_in
from identification.errors import MalformedLog
from plant.errors import AntidriveError, BadParameter

_READERS: MappingProxyType[str, tuple[str, Callable[..., Dataset]]] = MappingProxyType(
    {
        "emps": ("*.mat", emps.read),
        "kscale": ("*.npz", kscale.read),
        "bam": ("*.json", bam.read),
        "ur10e": ("*.npz", ur10e.read),
        "hsm150": ("*.mat", hsm150.read),
    }
)


def load_dataset(name: str, data: Path | str | Sequence[Path | str], *, joint: int | None = None) -> Dataset:
    """Read a known data set.

    Args:
        name: emps, kscale, bam, ur10e or hsm150.
        data: the folder with its files, or the files.
        joint: joint of a robot; only for ur10e.

    Raises:
        BadParameter: unknown name, missing folder, or a joint for a data set with one axis.
        MalformedLog: a file is missing or does not match the description of the data set.
    """
    if name not in _READERS:
        raise BadParameter(f"There is no data set {name!r}; known are {', '.join(_READERS)}.")
    if joint is not None and name != "ur10e":
        raise BadParameter(f"--joint goes with ur10e only; {name} has one axis.")
    pattern, read = _READERS[name]
    files = files_in(data, pattern)
    try:
        return read(files, joint=joint) if name == "ur10e" else read(files)
    except AntidriveError:
        raise
    except (OSError, LookupError, TypeError, ValueError) as error:  # arrays with the right names but other shapes
        raise MalformedLog(
            f"{files[0].name}: the arrays are not what the description of {name} says ({error}), fetch the files again."
        ) from error


__all__ = ["Dataset", "load_dataset"]
