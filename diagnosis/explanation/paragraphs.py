"""Explanation of a diagnosis: sentences with numbers, and data for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.experiment import Experiment
from diagnosis.explanation.posterior_sentences import posterior_sentences
from diagnosis.explanation.reasons import Reason, reason_for, reason_for_none
from diagnosis.explanation.wording import change, joined_words, measured, percent, predicted, torque_or_force
from diagnosis.holdout import gain_errors
from diagnosis.result import Findings
from identification.standard_errors import bandwidth_std

_LEAST_SHARE = 0.1  # share of the residual torque's variance from which a dependence on a variable is reported


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Explanation of a diagnosis; its string has all sentences in paragraphs.

    Attributes:
        missing: the residual torque, and the variable that it depends on.
        posterior: certain effects, alternatives, and the unexplained part.
        reasons: why each effect is reported, or why none is.
        outcome: the gain on validation data, and the remaining error.
    """

    missing: tuple[str, ...]
    posterior: tuple[str, ...]
    reasons: tuple[Reason, ...]
    outcome: tuple[str, ...]

    def __str__(self) -> str:
        """All sentences, in paragraphs."""
        parts = [("Residual torque", self.missing), ("What explains it", self.posterior)]
        parts += [(reason.title, reason.sentences) for reason in self.reasons]
        parts.append(("Validation", self.outcome))
        return "\n\n".join(f"{title}. {' '.join(sentences)}" for title, sentences in parts if sentences)


def explain(diagnosis: Findings, experiment: Experiment | None = None) -> Explanation:
    """Explain a diagnosis.

    Args:
        diagnosis: to be explained.
        experiment: designed to separate its competing sets, if any.
    """
    causes = tuple(reason_for(diagnosis, cause, experiment) for cause in diagnosis.causes)
    reasons = causes or (reason_for_none(diagnosis),)
    return Explanation(
        missing=_missing(diagnosis),
        posterior=posterior_sentences(diagnosis),
        reasons=reasons,
        outcome=_outcome(diagnosis),
    )


def _missing(diagnosis: Findings) -> tuple[str, ...]:
    """The residual torque of the base model, the variable it depends on, and the observers of both models."""
    lacked, base, extended = diagnosis.residual_before, diagnosis.base, diagnosis.extended
    noise, inertia = float(lacked.band.mean()) / 1.96, base["inertia"]
    relative_error = np.sqrt(0.5 / base.samples + (0.0 if not inertia.std else inertia.std / base.model.inertia) ** 2)
    of_noise = f"Measurement noise alone would give {measured(noise, noise * relative_error, lacked.unit)}."
    lines = [
        f"Below {lacked.cutoff:.2g} Hz the residual {torque_or_force(lacked.unit)} of the base model is "
        f"{measured(lacked.rms, lacked.rms_std, lacked.unit)} rms.{f' {of_noise}' if noise else ''}"
    ]
    most = lacked.curves[0]
    if most.share >= _LEAST_SHARE:
        lines.append(
            f"It depends on {most.variable}, which explains {percent(most.share, most.share_std)} of its variance."
        )
    else:
        lines.append(
            f"No single variable explains much of its variance; {most.variable} explains most, "
            f"{percent(most.share, most.share_std)}."
        )
    if base.bandwidth > 0.0:
        observers = [measured(fit.bandwidth, bandwidth_std(fit), "rad/s") for fit in (base, extended)]
        needs = "none" if extended.bandwidth == 0.0 else f"one of {observers[1]}"
        then = "" if extended is base else f"; the extended model needs {needs}"
        lines.append(
            f"To follow the log the base model needs an observer of {observers[0]}{then}. A model without errors needs "
            "none, if there are no disturbances."
        )
    return tuple(lines)


def _outcome(diagnosis: Findings) -> tuple[str, ...]:
    """The gain on validation data, the remaining error, and the whiteness."""
    gain, left, lines = diagnosis.gain, diagnosis.unexplained, []
    extended = diagnosis.extended is not diagnosis.base
    if gain is not None:
        error, floor = gain_errors(diagnosis), ""
        if gain.noise_floor:
            above = measured(gain.held_out_rms_after / gain.noise_floor, error.after / gain.noise_floor)
            floor = f"{above} times the {gain.floor_name}"
        by = "by " if gain.cut > -1.0 else ""
        went = f"{'reduced' if gain.cut >= 0.0 else 'increased'} {by}{change(gain.cut, error.cut)}, from "
        came = f"{went}{measured(gain.held_out_rms_before, error.before, gain.unit)} to " if extended else ""
        rms = f"{measured(gain.held_out_rms_after, error.after, gain.unit)} rms"
        lines.append(
            f"On validation data the {predicted(diagnosis)} error is {', '.join(filter(None, (came + rms, floor)))}."
        )
    if extended:
        std = gain_errors(diagnosis).share if gain is not None else None
        lines.append(f"Of the error power above the {gain.floor_name} {percent(left.share, std)} remains.")
    if left.depends_on:
        lines.append(f"What remains unexplained depends on {joined_words(left.depends_on)}.")
    known = diagnosis.whiteness
    # of a squared multiple correlation from n samples (Olkin and Finn 1995)
    past = percent(known, 2.0 * np.sqrt(known / diagnosis.extended.samples) * (1.0 - known))
    lines.append(
        f"Earlier one-step errors predict {past} of the variance of the next; of white noise they would predict none."
    )
    return tuple(lines)
