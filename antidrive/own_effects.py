"""Custom effects, defined in a Python file."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from identification.errors import Unidentifiable
from plant.effects import Effect, catalogue
from plant.effects.effect import Stage
from plant.errors import BadParameter
from plant.model_file import ModelFile, read_model


def read_effects(path: Path) -> tuple[type[Effect], ...]:
    """The classes of effects that a file defines, in its order.

    Raises:
        BadParameter: the file cannot be read or run, or defines no usable effect.
    """
    if not path.is_file():
        raise BadParameter(f"--effects {path}: there is no such file.")
    name = f"_effects_of_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadParameter(f"--effects {path}: is no Python file; give one that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and workers look it up there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise BadParameter(f"--effects {path}: {_place(path, error)}{type(error).__name__}: {error}.") from error
    own = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Effect)]
    found = tuple(dict.fromkeys(kind for kind in own if kind.__module__ == name))
    if not found:
        raise BadParameter(f"--effects {path}: defines no effect; write a class that derives from plant.Effect.")
    for kind in found:
        _check(path, kind)
    return found


def _check(path: Path, kind: type[Effect]) -> None:
    missing = [what for what in ("name", "title", "stage", "equation", "signature") if not hasattr(kind, what)]
    if missing:
        raise BadParameter(f"--effects {path}: {kind.__name__} does not say its {', '.join(missing)}.")
    if not isinstance(kind.stage, Stage):
        raise BadParameter(f"--effects {path}: the stage of {kind.__name__} must be one of {', '.join(Stage)}.")
    if kind.name in catalogue:
        raise BadParameter(f"--effects {path}: {kind.name!r} is an effect of the catalogue; give yours another name.")
    if "__dataclass_params__" not in vars(kind):
        raise BadParameter(f"--effects {path}: write @dataclass(frozen=True, kw_only=True) above {kind.__name__}.")


def _place(path: Path, error: Exception) -> str:
    """Location of an error in the file."""
    line = error.lineno if isinstance(error, SyntaxError) else None
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path.absolute()):
            line = trace.tb_lineno
        trace = trace.tb_next
    return "" if line is None else f"line {line}: "


def read_own_model(path: Path, effects: Path | None) -> ModelFile:
    """A model file, which may have the custom effects of another file."""
    return read_model(path, () if effects is None else read_effects(effects))


def read_identified(path: Path, effects: Path | None) -> ModelFile:
    """A model file for use in a controller or an export.

    Raises:
        Unidentifiable: it was fitted to a log that determines none of its parameters.
    """
    read = read_own_model(path, effects)
    if not read.identified:
        raise Unidentifiable(
            f"{path}: no parameter of this model was identified, its values are those that the fit began with; "
            "identify it from a log that shows them, or write the model file yourself."
        )
    return read
