"""Changes in diagnoses of drawn logs if a decisive constant is halved or doubled, or a rule is left out.

    python benchmarks/sensitivity.py run --seeds 3,17 [--processes 2] [--logs FOLDER]
    python benchmarks/sensitivity.py table

Logs and outcomes are those of `field`. `run` adds an outcome for each constant or rule and log to
benchmarks/results/sensitivity.jsonl; stored outcomes are not run again; `--rules` runs the rules only. `table` writes
sensitivity.txt: how many of the same logs are right, honest, missed or wrong, and how many have another verdict or
another sure effect than without the change. For a probability, the odds are halved and doubled; for several numbers,
all of them together.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import numpy as np  # noqa: E402
from field_outcome import outcome_of  # noqa: E402
from field_scoring import score  # noqa: E402
from field_workers import results  # noqa: E402

import diagnosis  # noqa: E402

STORE = HERE / "results" / "sensitivity.jsonl"
AS_IT_IS, LESS = "as it is", "less "


def as_a_whole(sets: Any, against: Any) -> Any:
    """Probabilities of sets from the whole log."""
    taken = [sum(min(reported.sum(), 0.0) for name, reported in against.items() if name in each.names) for each in sets]
    scores = np.array([each.log_marginal for each in sets]) + np.array(taken)
    weights = np.exp(scores - scores.max())
    return weights / weights.sum()


def no_rejection(*_: Any) -> Any:
    """No falsification by validation data."""
    falsification = sys.modules["diagnosis.falsification"]
    return falsification._Rejection(worse=0.0, against=np.zeros(falsification.BLOCKS))


CONSTANTS: dict[str, tuple[str, str]] = {
    "discrepancy.AMPLITUDES": ("diagnosis.evidence.discrepancy", "sizes of the unmodelled torque that are weighed"),
    "discrepancy._ERRORS": ("diagnosis.evidence.discrepancy", "sizes of errors of the measurement"),
    "families._HIGHEST_ORDER": ("diagnosis.evidence.families", "bends of a smooth function"),
    "families._LAGS": ("diagnosis.evidence.families", "lags of a torque [samples]"),
    "families._TRAVELS": ("diagnosis.evidence.families", "ways after which a direction is forgotten"),
    "prior._DECADES": ("diagnosis.evidence.prior", "log of the range of a size"),
    "jackknife.BLOCKS": ("diagnosis.jackknife", "blocks of the log that are drawn again"),
    "fitted_sets._ITERATIONS": ("diagnosis.evidence.fitted_sets", "iterations of a fit"),
    "larger_sets.FITTED_SETS": ("diagnosis.evidence.larger_sets", "sets that are fitted at once"),
    "verdict._NEAR_LARGEST": ("diagnosis.verdict", "from which a variable is told beside the most telling"),
    "levels.SURE": ("diagnosis.levels", "probability from which something is sure"),
    "levels.LIKELY": ("diagnosis.levels", "... and is told"),
    "levels.DECISIVE": ("diagnosis.levels", "log odds against what hardly ever comes"),
    "levels.SIGNIFICANT": ("diagnosis.levels", "standard errors that rule out; it follows from DECISIVE"),
    "levels.LEARNING_RATE": ("diagnosis.levels", "power of the posterior that is reported"),
    "levels.INEXACT": ("diagnosis.levels", "share by which laws and models are wrong"),
}
"""Each constant with its module and a description."""
RULES: dict[str, tuple[str, str, Any, str]] = {
    "discrepancy": ("diagnosis.evidence.discrepancy", "AMPLITUDES", (0.0, 1e-12), "an unmodelled torque in every set"),
    "alone": ("diagnosis.evidence.search_over_sets", "rise", lambda *_: None, "every effect fitted by itself"),
    "observers": ("diagnosis.evidence.search_over_sets", "_retune", lambda *_: None, "slower observers for the best"),
    "look-alikes": ("diagnosis.evidence.search_over_sets", "_in_place", lambda *_: [], "other names in its place"),
    "without name": (
        "diagnosis.evidence.search_over_sets",
        "_nonparametric",
        lambda *_: [],
        "no name in its place",
    ),
    "blocks": ("diagnosis.evidence.posterior", "over_blocks", as_a_whole, "the log drawn again by blocks"),
    "sizes": ("diagnosis.evidence.posterior", "kept_share", lambda *_: 1.0, "a cause is larger than what has no name"),
    "values": ("diagnosis.falsification", "_impossible", lambda *_: None, "values that rule an effect out"),
    "validation": ("diagnosis.falsification", "_rejection", no_rejection, "validation data that rule an effect out"),
    "curves": (
        "diagnosis.redundant_effects",
        "with_curves",
        lambda fit, base: fit,
        "what is left carried without a name",
    ),
    "validation only": (
        "diagnosis.diagnose_once",
        "only_in_validation",
        lambda *_: None,
        "what validation data alone show",
    ),
}
"""Each rule with the module and name of the replaced function, its replacement, and a description."""


def changed(log: Any, **how: Any) -> Any:
    """A diagnosis with the changed constant or rule in the environment variable."""
    name, _, factor = os.environ["CHANGED"].partition(" x ")
    if name.startswith(LESS):
        home, attribute, instead, _ = RULES[name.removeprefix(LESS)]
        setattr(sys.modules[home], attribute, instead)
    elif name != AS_IT_IS:
        home, attribute = CONSTANTS[name][0], name.rpartition(".")[2]
        value = getattr(sys.modules[home], attribute)
        for module in [each for place, each in sys.modules.items() if place.startswith("diagnosis")]:
            if getattr(module, attribute, None) is value and (attribute.isupper() or module.__name__ == home):
                setattr(module, attribute, scaled(value, float(factor)))
    return diagnosis.diagnose(log, **how)


def scaled(value: Any, factor: float) -> Any:
    """A constant halved or doubled."""
    if isinstance(value, tuple):
        return tuple(factor * each for each in value)
    if isinstance(value, int):
        return max(1, round(factor * value))
    if 0.5 <= value < 1.0:
        scaled_odds = factor * value / (1.0 - value)
        return scaled_odds / (1.0 + scaled_odds)
    return factor * value


def kept() -> dict[tuple[str, int], dict[str, Any]]:
    """The stored outcomes."""
    lines = STORE.read_text(encoding="utf-8").splitlines() if STORE.exists() else []
    return {(reported["changed"], reported["seed"]): reported for reported in map(json.loads, lines)}


def run(seeds: list[int], processes: int, logs: Path | None, *, rules_alone: bool) -> None:
    """Run all rules and constants on some logs, one after the other."""
    constants = [] if rules_alone else [f"{name} x {factor}" for name in CONSTANTS for factor in (0.5, 2.0)]
    for change in (AS_IT_IS, *(f"{LESS}{name}" for name in RULES), *constants):
        os.environ["CHANGED"] = change
        there = kept()
        missing = [seed for seed in seeds if (change, seed) not in there]
        work = partial(outcome_of, method="sensitivity:changed", folder=logs)
        for seed, reported in results(missing, work, processes, 300.0):
            with STORE.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"changed": change, "seed": seed} | reported) + "\n")
            print(change, seed, reported.get("verdict", reported.get("failed")), flush=True)


def table() -> str:
    """A line for each rule and constant."""
    found = kept()
    base = {
        seed: reported for (change, seed), reported in found.items() if change == AS_IT_IS and "verdict" in reported
    }
    lines = [f"{len(base)} logs: right, honest, missed, wrong, other answers", ""]
    lines += [f"{AS_IT_IS:24} {_counts(base, base)}"]
    for name, (*_, what) in RULES.items():
        reported = {seed: found[f"{LESS}{name}", seed] for seed in base if (f"{LESS}{name}", seed) in found}
        lines.append(f"{LESS + name:24} {_counts(reported, base)}   {what}")
    lines += ["", "Of half and of double the value", ""]
    for name, (_, what) in CONSTANTS.items():
        both = [{s: found[f"{name} x {f}", s] for s in base if (f"{name} x {f}", s) in found} for f in (0.5, 2.0)]
        lines.append(f"{name:24} {_counts(both[0], base)}   {_counts(both[1], base)}   {what}")
    return "\n".join(lines)


def _counts(given: dict[int, dict[str, Any]], base: dict[int, dict[str, Any]]) -> str:
    scored = [score(each).category if "verdict" in each else "crash" for each in given.values()]
    other = sum(_answer(each) != _answer(base[seed]) for seed, each in given.items())
    kinds = [scored.count(kind) for kind in ("right", "honest", "missed", "wrong")]
    return " ".join(f"{n:3d}" for n in (*kinds, other))


def _answer(given: dict[str, Any]) -> tuple[str | None, frozenset[str]]:
    sure = frozenset(name["effect"] for name in given.get("names", ()) if name["probability"] > 0.9)
    return given.get("verdict"), sure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "table"))
    parser.add_argument("--seeds", default="", help="of the logs, separated by commas")
    parser.add_argument("--rules", action="store_true", help="leave out the constants")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--logs", type=Path, default=None, help="folder in which drawn logs are kept")
    a = parser.parse_args()
    if a.what == "run":
        run([int(seed) for seed in a.seeds.split(",") if seed], a.processes, a.logs, rules_alone=a.rules)
    else:
        text = table()
        print(text)
        STORE.with_suffix(".txt").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
