"""Summary of many diagnoses: rates with intervals, reliability of the probabilities, confusions, losses by cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from confusion_matrix import matrix
from scipy.stats import beta

Answer = dict[str, Any]
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


def names(answer: Answer) -> list[str]:
    return [cause["effect"] for cause in answer["causes"]]


def alone(answer: Answer) -> bool:
    """Whether exactly the true effects are reported."""
    return answer["verdict"] == "named" and set(names(answer)) == set(answer["truth"])


def honest(answer: Answer) -> bool:
    """Whether the true effect is reported, or is among at most three competing effects of an ambiguous verdict."""
    if alone(answer):
        return True
    if answer["verdict"] != "ambiguous" or len(answer["causes"]) != 1:
        return False
    alternatives = answer["causes"][0]["rivals"]
    return len(alternatives) <= 2 and answer["truth"][0] in [*names(answer), *alternatives]


def not_misled(answer: Answer) -> bool:
    """Right, or `ambiguous` or `unknown` without a wrong effect above 0.9: right or honest, as on drawn machines."""
    sure = {cause["effect"] for cause in answer["causes"] if cause["probability"] > 0.9}
    return alone(answer) or (answer["verdict"] in ("ambiguous", "unknown") and sure <= set(answer["truth"]))


def shown(answer: Answer) -> bool:
    """Whether some size has about the required lambda: saturation, for example, is either strong or absent."""
    return bool(0.5 <= answer["lambda"] / answer["wanted"] <= 2.0)


def loss(answer: Answer) -> str:
    """Why a hidden effect was not reported: search, noise model, or statistics in favour of another effect."""
    if answer["own"] is None or answer["own"] < answer["oracle"] - 3.0:
        return "search" if answer["oracle"] > 15.0 else "noise model"
    return "statistics"


def table(stored: Sequence[Answer]) -> str:
    parts = {part: [t for t in stored if t["key"][0] == part] for part in ("hidden", "several", "deleted", "clean")}
    known = [t for t in stored if t["key"][0] != "deleted"]
    pages = [_hidden(parts["hidden"]), _reliability(known), _clean(parts["clean"]), _several(parts["several"])]
    pages.append(_deleted(parts["deleted"]))
    return "\n\n".join(page for page in pages if page)


def _hidden(answers: list[Answer]) -> str:
    undetectable = [t for t in answers if not shown(t)]
    answers = [t for t in answers if shown(t)]
    if not answers:
        return ""
    sizes = sorted({t["wanted"] for t in answers})
    lines = [
        f"{'effect':26}" + "".join(f"{f'lambda {size:.0f}':>16}" for size in sizes),
        "(named alone + honestly ambiguous + else named + unknown + nothing)",
    ]
    effects = list(dict.fromkeys(t["truth"][0] for t in sorted(answers, key=lambda t: t["key"][1])))
    for effect in effects:
        cells = []
        for size in sizes:
            cell = [t for t in answers if t["truth"] == [effect] and t["wanted"] == size]
            right = sum(alone(t) for t in cell)
            fair = sum(honest(t) for t in cell) - right
            rest = Counter(t["verdict"] for t in cell if not honest(t))
            wrong = rest["named"] + rest["ambiguous"]
            cells.append(f"{right}+{fair}+{wrong}+{rest['unknown']}+{rest['nothing_missing']}")
        lines.append(f"{effect:26}" + "".join(f"{cell:>16}" for cell in cells))
    for size in sizes:
        at = [t for t in answers if t["wanted"] == size]
        lines.append(f"lambda {size:.0f}: alone or honestly ambiguous {rate(sum(map(honest, at)), len(at))}")
        lines.append(f"lambda {size:.0f}: right, or not sure {rate(sum(map(not_misled, at)), len(at))}")
        lines.append(f"lambda {size:.0f}: named alone {rate(sum(map(alone, at)), len(at))}")
        seen = sum(t["verdict"] != "nothing_missing" for t in at)
        lines.append(f"lambda {size:.0f}: detected {rate(seen, len(at))}")
    apart = [t for t in answers if "rival" in t and 2.0 * (t["oracle"] - t["rival"]) >= _SEPARABLE]
    lines.append(
        f"lambda over the best other name {_SEPARABLE:.0f}: named alone {rate(sum(map(alone, apart)), len(apart))}"
    )
    certain = [
        t for t in answers if any(c["probability"] > 0.99 and c["effect"] not in t["truth"] for c in t["causes"])
    ]
    lines.append(f"a wrong name with more than 99 %: {rate(len(certain), len(answers))}")
    lines.append(f"seconds: median {np.median([t['seconds'] for t in answers]):.1f}, 95 % {_p95(answers):.1f}")
    lines += _over_the_oracle([t for t in answers if alone(t)])
    lines.append(_no_worse(answers))
    lost = [t for t in answers if not honest(t)]
    spared = Counter(t["truth"][0] for t in undetectable)
    lines.append(f"left out, because no size of the effect has about that lambda on that log: {dict(spared) or 'none'}")
    lines += ["", matrix(answers, effects)]
    lines += ["", "losses: " + (", ".join(f"{k} {v}" for k, v in Counter(map(loss, lost)).items()) or "none")]
    for t in sorted(lost, key=lambda t: t["key"][1:]):
        text = ", ".join(f"{c['effect']} {c['probability']:.3f}" for c in t["causes"]) or t["verdict"]
        own = "-" if t["own"] is None else f"{t['own']:.1f}"
        over = ", ".join(t["depends_on"])
        lines.append(
            f"  {t['truth'][0]} {t['size']:.4g} lambda {t['wanted']:.0f} seed {t['key'][2]}: {t['verdict']} {text}"
            f" ({over}); evidence of the truth {own}, of the oracle {t['oracle']:.1f}: {loss(t)}"
        )
    return "\n".join(lines)


def _over_the_oracle(answers: list[Answer]) -> list[str]:
    """Validation error relative to that of a fit with the true effects, and the cases with a much larger one."""
    if not answers:
        return []
    ratios = np.array([t["errors"][1] / t["errors"][2] for t in answers])
    middle, most = np.median(ratios), np.quantile(ratios, 0.95)
    lines = [
        f"held-out error over the oracle's, named alone: median {middle:.4f}, 95 % {most:.4f}",
        f"  no more than {_NEAR:g} times: {rate(int(np.sum(ratios <= _NEAR)), len(answers))}",
    ]
    far = [(t, ratio) for t, ratio in zip(answers, ratios, strict=True) if ratio > _NEAR]
    return lines + [f"  {t['truth'][0]} lambda {t['wanted']:.0f}: {ratio:.3g} times" for t, ratio in far]


def _no_worse(answers: list[Answer]) -> str:
    """How often the extended model has a larger validation error than the base model and the true model."""
    worse = [extended > 1.05 * max(base, oracle) for base, extended, oracle in (t["errors"] for t in answers)]
    return f"held-out error a twentieth above the base's and the oracle's: {rate(sum(worse), len(worse))}"


def _p95(answers: list[Answer]) -> float:
    return float(np.quantile([t["seconds"] for t in answers], 0.95))


def _reliability(stored: Sequence[Answer]) -> str:
    """Share of correct effects, by reported probability."""
    pairs = []
    for t in stored:
        for cause in t["causes"]:
            pairs += [(cause["probability"], cause["effect"] in t["truth"])]
            pairs += [(share, alternative in t["truth"]) for alternative, share in cause["rivals"].items()]
    if not pairs:
        return ""
    lines, error = ["reliability of the odds: probability said, share right"], 0.0
    for low, high in pairwise(_BINS):
        inside = [(p, right) for p, right in pairs if low <= p < high]
        if inside:
            stated, right = float(np.mean([p for p, _ in inside])), sum(r for _, r in inside)
            error += abs(stated - right / len(inside)) * len(inside) / len(pairs)
            lines.append(f"  {low:.4g} to {min(high, 1.0):.4g}: said {stated:.4f}, right {rate(right, len(inside))}")
    lines.append(f"expected calibration error {error:.4f}, over {len(pairs)} names")
    return "\n".join(lines)


def _clean(answers: list[Answer]) -> str:
    if not answers:
        return ""
    lines = ["nothing hidden: names or doubts, and unknown"]
    for kind in dict.fromkeys(t["kind"] for t in answers):
        of = [t for t in answers if t["kind"] == kind]
        named = [t for t in of if t["causes"]]
        unknown = sum(t["verdict"] == "unknown" for t in of)
        counted = Counter(name for t in named for name in names(t))
        lines.append(f"  {kind:26}{rate(len(named), len(of)):44} unknown {unknown}   {dict(counted) or ''}")
    lines.append(f"  a name: {rate(sum(bool(t['causes']) for t in answers), len(answers))}")
    lines.append(
        f"  anything but nothing: {rate(sum(t['verdict'] != 'nothing_missing' for t in answers), len(answers))}"
    )
    return "\n".join(lines)


def _several(answers: list[Answer]) -> str:
    if not answers:
        return ""
    exact = sum(_shown(t) <= _set(t) <= set(t["truth"]) for t in answers)
    found = sum(_shown(t) <= _set(t) for t in answers)
    lines = [
        f"several at once: exact set {rate(exact, len(answers))}",
        f"  all true ones found {rate(found, len(answers))}",
        f"  (asked for are those with a lambda of {_DETECTED:g} beside the others; a load at rest shows none)",
    ]
    for t in answers:
        if _set(t) != set(t["truth"]):
            hidden = [f", lambda of {name} {t['shown'][name]:.1f}" for name in sorted(set(t["truth"]) - _shown(t))]
            answer = f"{t['verdict']} {', '.join(names(t))}{''.join(hidden)}"
            lines.append(f"  {' + '.join(t['truth'])} seed {t['key'][2]}: {answer}")
    return "\n".join(lines)


def _shown(answer: Answer) -> set[str]:
    """The true effects that the log shows, as far as that was measured."""
    return {name for name in answer["truth"] if answer.get("shown", {}).get(name, np.inf) >= _DETECTED}


def _set(answer: Answer) -> set[str]:
    """The reported effects; a true effect also counts if it is among at most three competing effects."""
    found = set()
    for cause in answer["causes"]:
        alternatives = (
            [] if cause["probability"] >= 0.9 else [n for n, share in cause["rivals"].items() if share >= 0.05]
        )
        honest = [name for name in alternatives if name in answer["truth"]] if len(alternatives) <= 2 else []
        found |= {cause["effect"]} if cause["effect"] in answer["truth"] or not honest else {honest[0]}
    return found


def _deleted(answers: list[Answer]) -> str:
    """Diagnoses without the true effect in the catalogue: an effect reported without any reservation is wrong."""
    if not answers:
        return ""
    unreported = [t for t in answers if t["verdict"] == "named" and not t["depends_on"] and t["unexplained"] < _MUCH]
    alike = [t for t in unreported if set(names(t)) <= EQUIVALENT.get(t["truth"][0], set())]
    gains = [(1 - t["errors"][1] / t["errors"][0]) / (1 - t["errors"][2] / t["errors"][0]) for t in answers]
    lines = [
        f"true effect not in the catalogue: named without a doubt {rate(len(unreported), len(answers))},",
        f"  of these {len(alike)} by an effect that does the same on such a log, silently wrong "
        f"{rate(len(unreported) - len(alike), len(answers))}",
        "  (a doubt: another verdict, a variable, or more than a tenth of the held-out error power unexplained)",
        f"  share of the oracle's gain that is had all the same: median {np.median(gains):.3f}",
        f"  {_no_worse(answers)}",
    ]
    for t in sorted(answers, key=lambda t: t["key"][1:]):
        gain = (1 - t["errors"][1] / t["errors"][0]) / (1 - t["errors"][2] / t["errors"][0])
        text = ", ".join(f"{c['effect']} {c['probability']:.3f}" for c in t["causes"]) or "-"
        over = ", ".join(t["depends_on"]) or "-"
        left = f"unexplained {t['unexplained']:.3f} gain {gain:.3f}"
        lines.append(f"  {t['truth'][0]:26}{t['verdict']:16}{text:50}over {over:24} {left}")
    return "\n".join(lines)
