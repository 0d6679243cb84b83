"""Scores of an outcome of `field_outcome`: right, honest or wrong, by fixed rules.

A reported effect is *sure* above a probability of 0.9. It is *false* if it is neither hidden in the log nor equivalent
to a hidden effect by the table of confounded effects. A false sure effect is a *part of the rest* if its torque is no
larger than the unmodelled torque of that log, and *wrong* if it is larger or is no torque. A more general effect
(Stribeck for Coulomb friction) is not false while its excess is below 0.3 % of the torque or below the rest. A special
case (Coulomb friction for Stribeck) is present, so it is not false either; but the hidden effect is then not reported.

Only effects that the log shows must be reported: an effect is *expected* if its lambda is above 60 and the torque that
is missing without it is above the rest. Reporting the others is no fault.

    crash    an error was raised, or the time limit was reached
    wrong    a false sure effect that is no part of the rest
    right    every expected effect is sure
    honest   otherwise, if the verdict is "ambiguous" or "unknown"
    missed   otherwise, if the verdict is "named" or "nothing_missing"

If an expected effect was left out of the catalogue, only "unknown" or "ambiguous" is honest, and nothing is right. A
measured current is delayed by its filter; that is no hidden effect: reporting it is right but not expected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Outcome = dict[str, Any]
SURE = 0.9
TELLING = 60.0
SMALL = 0.003  # fraction of the torque
NO_TORQUE = {
    *("input_delay", "actuator_lag", "rate_limit", "setpoint_rate_limit"),
    *("compliance", "backlash", "encoder_eccentricity", "sensor_lag", "torque_measurement_lag"),
}
PARTS: dict[str, tuple[str, ...]] = {
    "stribeck_friction": ("coulomb_friction",),
    "presliding_hysteresis": ("coulomb_friction",),
    "friction_drift": ("coulomb_friction",),
    "asymmetric_friction": ("coulomb_friction", "torque_offset"),
    "cable_stiffness": ("torque_offset",),
}
"""Special cases of an effect, which are present with it."""
_OVER: tuple[tuple[set[str], tuple[str, ...]], ...] = (
    ({"velocity"}, ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "quadratic_drag")),
    ({"angle"}, ("gravity_offset", "cable_stiffness", "cogging", "encoder_eccentricity", "end_stop")),
    ({"time"}, ("periodic_disturbance", "payload_change")),
    ({"torque", "lagged torque"}, ("input_delay", "actuator_lag", "sensor_lag", "compliance", "backlash")),
    ({"torque", "lagged torque"}, ("rate_limit", "setpoint_rate_limit", "torque_saturation")),
    ({"velocity", "angle", "travel since reversal"}, ("presliding_hysteresis",)),
    ({"velocity", "torque"}, ("load_dependent_friction", "back_emf")),
    ({"time", "velocity"}, ("friction_drift",)),
)
VARIABLES = {name: variables for variables, names in _OVER for name in names}
"""Variables of a hidden effect, as a diagnosis reports them: any of these is right. A constant depends on none."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Score of an outcome.

    Attributes:
        wrong, part: false sure effects, larger than the rest and not.
        lost: expected effects that are not sure.
        unreported: whether nothing is reported on an expected effect that was left out; None if none was.
        variable: whether its right variable is reported; None if none was left out or it has none.
        events: reported probabilities, each with whether it is true.
        unmentioned: number of expected effects that are not mentioned.
    """

    category: str
    wrong: tuple[str, ...] = ()
    part: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    unreported: bool | None = None
    variable: bool | None = None
    events: tuple[tuple[float, bool], ...] = ()
    unmentioned: int = 0

    @property
    def exact(self) -> bool:
        return self.category == "right" and not self.part


def score(outcome: Outcome) -> Score:
    """The score of one log."""
    left = outcome["left_out"]
    absent = [h for h in outcome["truth"] if h["name"] == left and _expected(h, outcome)]
    if "failed" in outcome:
        return Score(category="crash", unreported=False if absent else None)
    sure = [reported for reported in outcome["names"] if reported["probability"] > SURE]
    false = [reported for reported in sure if not _true(reported, outcome)]
    part = [reported["effect"] for reported in false if _within_rest(reported, outcome)]
    wrong = [reported["effect"] for reported in false if reported["effect"] not in part]
    named = {reported["effect"] for reported in sure}
    lost = [h["name"] for h in outcome["truth"] if h["name"] != left and _expected(h, outcome) and not _found(h, named)]
    open_minded = outcome["verdict"] in ("ambiguous", "unknown")
    if wrong:
        category = "wrong"
    elif absent or lost:
        category = "honest" if open_minded else "missed"
    else:
        category = "right"
    variables = VARIABLES.get(left or "")
    return Score(
        category=category,
        wrong=tuple(wrong),
        part=tuple(part),
        lost=tuple(lost),
        unreported=bool(wrong) or not open_minded if absent else None,
        variable=bool(variables & set(outcome["depends_on"])) if absent and variables else None,
        events=_events(outcome),
        unmentioned=sum(not _mentioned(h, outcome) for h in outcome["truth"] if h["name"] in lost),
    )


def _expected(hidden: dict[str, Any], outcome: Outcome) -> bool:
    """Whether the log shows it clearly, and as more than a part of the rest."""
    return bool(hidden["visible"] >= TELLING and hidden["size"] > outcome["rest"])


def _found(hidden: dict[str, Any], named: set[str]) -> bool:
    return hidden["name"] in named or any(set(reported) <= named for reported in hidden["alike"])


def _true(given: dict[str, Any], outcome: Outcome) -> bool:
    """Whether it is hidden in the log or equivalent to a hidden effect; a measured current is always filtered."""
    if given["effect"] == "torque_measurement_lag":
        return bool(outcome["loop"] == "closed, current")
    if any(given["effect"] in (h["name"], *PARTS.get(h["name"], ())) for h in outcome["truth"]):
        return True
    if not any(given["effect"] in names for h in outcome["truth"] for names in h["alike"]):
        return False
    holds = any(h["name"] in ("coulomb_friction", "torque_offset") for h in outcome["truth"])
    wider = given.get("wider")
    return not holds or wider is None or wider <= max(outcome["rest"], SMALL * outcome["level"])


def _within_rest(given: dict[str, Any], outcome: Outcome) -> bool:
    return given["effect"] not in NO_TORQUE and given["rms"] is not None and given["rms"] <= outcome["rest"]


def _mentioned(hidden: dict[str, Any], outcome: Outcome) -> bool:
    """Whether it, or an equivalent effect, is reported with any probability."""
    alike = {hidden["name"], *(one for names in hidden["alike"] for one in names)}
    return any(
        effect in alike
        for n in outcome["names"]
        for effect in (n["effect"], *(other for other, _ in n["alternatives"]))
    )


def _events(outcome: Outcome) -> tuple[tuple[float, bool], ...]:
    """Every reported probability, with whether it is true.

    Those of equivalent effects are added, and those of special cases: what is told of Coulomb friction in place of
    Stribeck friction says that there is dry friction, and not that Coulomb friction alone is there.
    """
    reported: dict[str, float] = {}
    for name in outcome["names"]:
        for effect, probability in ((name["effect"], name["probability"]), *name["alternatives"]):
            if effect != "none":
                reported[effect] = max(reported.get(effect, 0.0), float(probability))
    events, used = [], set()
    for h in outcome["truth"]:
        alike = {h["name"], *PARTS.get(h["name"], ()), *(one for names in h["alike"] for one in names)}
        mine = {name: p for name, p in reported.items() if name in alike}
        used |= set(mine)
        if mine:
            events.append((min(1.0, sum(mine.values())), True))
    parts = {part for h in outcome["truth"] for part in PARTS.get(h["name"], ())}
    if outcome["loop"] == "closed, current":
        parts.add("torque_measurement_lag")
    events += [(p, name in parts) for name, p in reported.items() if name not in used]
    return tuple(events)
