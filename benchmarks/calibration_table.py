"""Summary of many diagnoses: rates with intervals, reliability of the probabilities, confusions, losses by cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from confusion_matrix import matrix
from scipy.stats import beta

Told = dict[str, Any]
_SEPARABLE = 25.0  # lambda of the truth over the best other effect
_DETECTED = 30.0  # lambda from which an effect is to be detected
_NEAR = 1.2  # factor on the oracle's error
_MUCH = 0.1  # share of the validation error power from which an unexplained part is reported
EQUIVALENT = {  # in an open loop, at these sizes
    "input_delay": {"sensor_lag", "actuator_lag"},
    "actuator_lag": {"sensor_lag", "input_delay"},
    "sensor_lag": {"input_delay", "actuator_lag"},
    "gravity_offset": {"cogging"},  # of order one
    "coulomb_friction": {"asymmetric_friction"},  # with two equal levels
}
_BINS = (0.0, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0000001)


def rate(good: int, of: int) -> str:
    """A rate with its 95 % interval (Clopper and Pearson)."""
    if not of:
        return "-"
    low = beta.ppf(0.025, good, of - good + 1) if good else 0.0
    high = beta.ppf(0.975, good + 1, of - good) if good < of else 1.0
    return f"{good} of {of} = {100 * good / of:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def names(told: Told) -> list[str]:
    return [cause["effect"] for cause in told["causes"]]


def alone(told: Told) -> bool:
    """Whether exactly the true effects are reported."""
    return told["verdict"] == "named" and set(names(told)) == set(told["truth"])


def honest(told: Told) -> bool:
    """Whether the true effect is reported, or is among at most three competing effects of an ambiguous verdict."""
    if alone(told):
        return True
    if told["verdict"] != "ambiguous" or len(told["causes"]) != 1:
        return False
    rivals = told["causes"][0]["rivals"]
    return len(rivals) <= 2 and told["truth"][0] in [*names(told), *rivals]


def not_misled(told: Told) -> bool:
    """Right, or `ambiguous` or `unknown` without a wrong effect above 0.9: right or honest, as on drawn machines."""
    sure = {cause["effect"] for cause in told["causes"] if cause["probability"] > 0.9}
    return alone(told) or (told["verdict"] in ("ambiguous", "unknown") and sure <= set(told["truth"]))


def shown(told: Told) -> bool:
    """Whether some size has about the required lambda: saturation, for example, is either strong or absent."""
    return bool(0.5 <= told["lambda"] / told["wanted"] <= 2.0)


def loss(told: Told) -> str:
    """Why a hidden effect was not reported: search, noise model, or statistics in favour of another effect."""
    if told["own"] is None or told["own"] < told["oracle"] - 3.0:
        return "search" if told["oracle"] > 15.0 else "noise model"
    return "statistics"


def table(stored: Sequence[Told]) -> str:
    parts = {part: [t for t in stored if t["key"][0] == part] for part in ("hidden", "several", "deleted", "clean")}
    known = [t for t in stored if t["key"][0] != "deleted"]
    pages = [_hidden(parts["hidden"]), _reliability(known), _clean(parts["clean"]), _several(parts["several"])]
    pages.append(_deleted(parts["deleted"]))
    return "\n\n".join(page for page in pages if page)


def _hidden(told: list[Told]) -> str:
    hardly = [t for t in told if not shown(t)]
    told = [t for t in told if shown(t)]
    if not told:
        return ""
    sizes = sorted({t["wanted"] for t in told})
    lines = [
        f"{'effect':26}" + "".join(f"{f'lambda {size:.0f}':>16}" for size in sizes),
        "(named alone + honestly ambiguous + else named + unknown + nothing)",
    ]
    effects = list(dict.fromkeys(t["truth"][0] for t in sorted(told, key=lambda t: t["key"][1])))
    for effect in effects:
        cells = []
        for size in sizes:
            cell = [t for t in told if t["truth"] == [effect] and t["wanted"] == size]
            right = sum(alone(t) for t in cell)
            fair = sum(honest(t) for t in cell) - right
            rest = Counter(t["verdict"] for t in cell if not honest(t))
            wrong = rest["named"] + rest["ambiguous"]
            cells.append(f"{right}+{fair}+{wrong}+{rest['unknown']}+{rest['nothing_missing']}")
        lines.append(f"{effect:26}" + "".join(f"{cell:>16}" for cell in cells))
    for size in sizes:
        at = [t for t in told if t["wanted"] == size]
        lines.append(f"lambda {size:.0f}: alone or honestly ambiguous {rate(sum(map(honest, at)), len(at))}")
        lines.append(f"lambda {size:.0f}: right, or not sure {rate(sum(map(not_misled, at)), len(at))}")
        lines.append(f"lambda {size:.0f}: named alone {rate(sum(map(alone, at)), len(at))}")
        seen = sum(t["verdict"] != "nothing_missing" for t in at)
        lines.append(f"lambda {size:.0f}: detected {rate(seen, len(at))}")
    apart = [t for t in told if "rival" in t and 2.0 * (t["oracle"] - t["rival"]) >= _SEPARABLE]
    lines.append(
        f"lambda over the best other name {_SEPARABLE:.0f}: named alone {rate(sum(map(alone, apart)), len(apart))}"
    )
    certain = [t for t in told if any(c["probability"] > 0.99 and c["effect"] not in t["truth"] for c in t["causes"])]
    lines.append(f"a wrong name with more than 99 %: {rate(len(certain), len(told))}")
    lines.append(f"seconds: median {np.median([t['seconds'] for t in told]):.1f}, 95 % {_p95(told):.1f}")
    lines += _over_the_oracle([t for t in told if alone(t)])
    lines.append(_no_worse(told))
    lost = [t for t in told if not honest(t)]
    spared = Counter(t["truth"][0] for t in hardly)
    lines.append(f"left out, because no size of the effect has about that lambda on that log: {dict(spared) or 'none'}")
    lines += ["", matrix(told, effects)]
    lines += ["", "losses: " + (", ".join(f"{k} {v}" for k, v in Counter(map(loss, lost)).items()) or "none")]
    for t in sorted(lost, key=lambda t: t["key"][1:]):
        said = ", ".join(f"{c['effect']} {c['probability']:.3f}" for c in t["causes"]) or t["verdict"]
        own = "-" if t["own"] is None else f"{t['own']:.1f}"
        over = ", ".join(t["depends_on"])
        lines.append(
            f"  {t['truth'][0]} {t['size']:.4g} lambda {t['wanted']:.0f} seed {t['key'][2]}: {t['verdict']} {said}"
            f" ({over}); evidence of the truth {own}, of the oracle {t['oracle']:.1f}: {loss(t)}"
        )
    return "\n".join(lines)


def _over_the_oracle(told: list[Told]) -> list[str]:
    """Validation error relative to that of a fit with the true effects, and the cases with a much larger one."""
    if not told:
        return []
    ratios = np.array([t["errors"][1] / t["errors"][2] for t in told])
    middle, most = np.median(ratios), np.quantile(ratios, 0.95)
    lines = [
        f"held-out error over the oracle's, named alone: median {middle:.4f}, 95 % {most:.4f}",
        f"  no more than {_NEAR:g} times: {rate(int(np.sum(ratios <= _NEAR)), len(told))}",
    ]
    far = [(t, ratio) for t, ratio in zip(told, ratios, strict=True) if ratio > _NEAR]
    return lines + [f"  {t['truth'][0]} lambda {t['wanted']:.0f}: {ratio:.3g} times" for t, ratio in far]


def _no_worse(told: list[Told]) -> str:
    """How often the extended model has a larger validation error than the base model and the true model."""
    worse = [extended > 1.05 * max(base, oracle) for base, extended, oracle in (t["errors"] for t in told)]
    return f"held-out error a twentieth above the base's and the oracle's: {rate(sum(worse), len(worse))}"


def _p95(told: list[Told]) -> float:
    return float(np.quantile([t["seconds"] for t in told], 0.95))


def _reliability(stored: Sequence[Told]) -> str:
    """Share of correct effects, by reported probability."""
    pairs = []
    for t in stored:
        for cause in t["causes"]:
            pairs += [(cause["probability"], cause["effect"] in t["truth"])]
            pairs += [(share, rival in t["truth"]) for rival, share in cause["rivals"].items()]
    if not pairs:
        return ""
    lines, error = ["reliability of the odds: probability said, share right"], 0.0
    for low, high in pairwise(_BINS):
        inside = [(p, right) for p, right in pairs if low <= p < high]
        if inside:
            said, right = float(np.mean([p for p, _ in inside])), sum(r for _, r in inside)
            error += abs(said - right / len(inside)) * len(inside) / len(pairs)
            lines.append(f"  {low:.4g} to {min(high, 1.0):.4g}: said {said:.4f}, right {rate(right, len(inside))}")
    lines.append(f"expected calibration error {error:.4f}, over {len(pairs)} names")
    return "\n".join(lines)


def _clean(told: list[Told]) -> str:
    if not told:
        return ""
    lines = ["nothing hidden: names or doubts, and unknown"]
    for kind in dict.fromkeys(t["kind"] for t in told):
        of = [t for t in told if t["kind"] == kind]
        named = [t for t in of if t["causes"]]
        unknown = sum(t["verdict"] == "unknown" for t in of)
        said = Counter(name for t in named for name in names(t))
        lines.append(f"  {kind:26}{rate(len(named), len(of)):44} unknown {unknown}   {dict(said) or ''}")
    lines.append(f"  a name: {rate(sum(bool(t['causes']) for t in told), len(told))}")
    lines.append(f"  anything but nothing: {rate(sum(t['verdict'] != 'nothing_missing' for t in told), len(told))}")
    return "\n".join(lines)


def _several(told: list[Told]) -> str:
    if not told:
        return ""
    exact = sum(_shown(t) <= _set(t) <= set(t["truth"]) for t in told)
    found = sum(_shown(t) <= _set(t) for t in told)
    lines = [
        f"several at once: exact set {rate(exact, len(told))}",
        f"  all true ones found {rate(found, len(told))}",
        f"  (asked for are those with a lambda of {_DETECTED:g} beside the others; a load at rest shows none)",
    ]
    for t in told:
        if _set(t) != set(t["truth"]):
            hidden = [f", lambda of {name} {t['shown'][name]:.1f}" for name in sorted(set(t["truth"]) - _shown(t))]
            told_as = f"{t['verdict']} {', '.join(names(t))}{''.join(hidden)}"
            lines.append(f"  {' + '.join(t['truth'])} seed {t['key'][2]}: {told_as}")
    return "\n".join(lines)


def _shown(told: Told) -> set[str]:
    """The true effects that the log shows, as far as that was measured."""
    return {name for name in told["truth"] if told.get("shown", {}).get(name, np.inf) >= _DETECTED}


def _set(told: Told) -> set[str]:
    """The reported effects; a true effect also counts if it is among at most three competing effects."""
    found = set()
    for cause in told["causes"]:
        rivals = [] if cause["probability"] >= 0.9 else [n for n, share in cause["rivals"].items() if share >= 0.05]
        honest = [name for name in rivals if name in told["truth"]] if len(rivals) <= 2 else []
        found |= {cause["effect"]} if cause["effect"] in told["truth"] or not honest else {honest[0]}
    return found


def _deleted(told: list[Told]) -> str:
    """Diagnoses without the true effect in the catalogue: an effect reported without any reservation is wrong."""
    if not told:
        return ""
    silent = [t for t in told if t["verdict"] == "named" and not t["depends_on"] and t["unexplained"] < _MUCH]
    alike = [t for t in silent if set(names(t)) <= EQUIVALENT.get(t["truth"][0], set())]
    gains = [(1 - t["errors"][1] / t["errors"][0]) / (1 - t["errors"][2] / t["errors"][0]) for t in told]
    lines = [
        f"true effect not in the catalogue: named without a doubt {rate(len(silent), len(told))},",
        f"  of these {len(alike)} by an effect that does the same on such a log, silently wrong "
        f"{rate(len(silent) - len(alike), len(told))}",
        "  (a doubt: another verdict, a variable, or more than a tenth of the held-out error power unexplained)",
        f"  share of the oracle's gain that is had all the same: median {np.median(gains):.3f}",
        f"  {_no_worse(told)}",
    ]
    for t in sorted(told, key=lambda t: t["key"][1:]):
        gain = (1 - t["errors"][1] / t["errors"][0]) / (1 - t["errors"][2] / t["errors"][0])
        said = ", ".join(f"{c['effect']} {c['probability']:.3f}" for c in t["causes"]) or "-"
        over = ", ".join(t["depends_on"]) or "-"
        left = f"unexplained {t['unexplained']:.3f} gain {gain:.3f}"
        lines.append(f"  {t['truth'][0]:26}{t['verdict']:16}{said:50}over {over:24} {left}")
    return "\n".join(lines)
