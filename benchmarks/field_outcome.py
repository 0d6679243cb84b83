"""The diagnosis of one drawn log: hidden effects, reported effects, their torques, and the computing time [s].

An outcome is a dict that fits into a line of JSON. The result of a diagnosis is taken from its `to_dict()`, the
contract of diagnosis.json, so that another implementation is measured in the same way. The torque of a reported effect
is computed with the extended model along the log's measured motion, not taken from the diagnosis.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from drawn_machines import Drawn, drawn

Outcome = dict[str, Any]
SURE = 0.9


def outcome_of(seed: int, method: str, folder: Path | None) -> Outcome:
    """The log of a seed and the result of `method`, "module:function", on it."""
    made = drawn(seed, folder)
    truth = made.facts()
    facts = {key: truth[key] for key in ("seed", "kind", "loop", "rate", "clock", "rest_share", "rest", "level")}
    facts |= {"samples": int(made.channels["time"].size), "truth": truth["truth"], "exclude": list(made.exclude)}
    facts["left_out"] = made.left_out
    begin, worked = time.perf_counter(), time.process_time()
    try:
        found = diagnoser(method)(made.log, exclude=made.exclude)
    except Exception as error:
        return facts | {"failed": f"{type(error).__name__}: {error}", "seconds": time.perf_counter() - begin}
    facts |= {"seconds": time.perf_counter() - begin, "processor": time.process_time() - worked}
    return facts | reported_of(found, made)


def diagnoser(method: str) -> Callable[..., Any]:
    """The function given as "module:function"."""
    module, _, name = method.partition(":")
    function: Callable[..., Any] = getattr(importlib.import_module(module), name or "diagnose")
    return function


def reported_of(found: Any, made: Drawn) -> Outcome:
    """Verdict, reported effects with probabilities and sizes, and the variables of the unexplained part."""
    found_dict = found.to_dict()
    names = [
        {
            "effect": cause["effect"],
            "probability": float(cause["probability"]),
            "grade": grade,
            "alternatives": [[a["effect"], float(a["probability"])] for a in cause.get("alternatives", ())],
            "told_rms": cause.get("rms"),
            **torque_of(found, cause["effect"]),
        }
        for grade, key in (("cause", "causes"), ("minor", "minor"))
        for cause in found_dict.get(key, ())
    ]
    unknown = found_dict.get("unknown", found_dict.get("unexplained", {}))
    return {
        "verdict": found_dict["verdict"],
        "names": names,
        "depends_on": list(unknown.get("depends_on", ())),
        "unknown": unknown.get("probability"),
    }


def torque_of(found: Any, name: str) -> dict[str, float | None]:
    """rms torque of a reported effect along the log [N m], and of its excess over a special case; None if unknown."""
    model, sizes = found.model, {"rms": None, "wider": None}
    effect = model.effect(name)
    if effect is None:
        return sizes
    try:
        whole = _missing(found, model)
        sizes["rms"] = _rms(whole - _missing(found, model.without_effect(name)))
        for special in effect.reduced():
            if special.name in ("coulomb_friction", "torque_offset"):
                narrow = model.without_effect(name).with_effect(special)
                sizes["wider"] = _rms(whole - _missing(found, narrow))
    except Exception:
        return sizes  # an effect whose torque cannot be computed counts as a large one
    return sizes


def _missing(found: Any, model: Any) -> np.ndarray:
    """(T,) torque that a model lacks along the measured motion [N m]."""
    from diagnosis.residual_torque import noise_cutoff
    from identification.inverse import filtered_motion, needed_torque
    from identification.run_parameters import own_model

    cutoff, parts = noise_cutoff(found.extended), []
    for run in found.extended.log.runs:
        motion = filtered_motion(run, cutoff, model)
        edge = min(motion.time.size // 10, int(1.0 / (cutoff * run.sample_time)))
        missing = needed_torque(own_model(run, model), motion) - motion.torque
        parts.append(missing[edge : motion.time.size - edge])
    return np.concatenate(parts)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
