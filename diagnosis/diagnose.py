"""Diagnose: from a log to the effects that a model lacks, with the gain on validation data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from diagnosis.candidates import Choice, chosen
from diagnosis.diagnose_once import diagnose_once
from diagnosis.diagnosis import Diagnosis
from diagnosis.explanation.wording import joined_words, title_of
from diagnosis.inverse_model import unexplained_torque
from diagnosis.levels import LIKELY, SURE
from diagnosis.validation_only import is_of_parameters, only_in_validation
from diagnosis.validation_split import fitted_too, parts, split_otherwise
from identification.errors import Unidentifiable
from identification.feedback import torque_responds
from identification.fit import base_model, known_of
from identification.log import Log
from identification.log_like import LogLike, log_of
from identification.prior_knowledge import Fixed, Pairs, PriorKnowledge
from identification.threads import without_blas_threads
from plant.effects.effect import Effect
from plant.model_file import ModelLike, model_of
from plant.servo import ServoModel

_INVERSE = (
    "The torque is predicted from the motion (inverse model): it does not show effects of the actuator, of a flexible "
    "drivetrain and of the sensor, and its sizes hold for a tight loop."
)


@without_blas_threads
def diagnose(
    log: LogLike,
    base: ModelLike | None = None,
    holdout: LogLike | None = None,
    *,
    fixed: Fixed = (),
    bounds: Pairs | None = None,
    prior: Pairs | None = None,
    candidates: Sequence[Choice] | None = None,
    exclude: Collection[str] = (),
    inverse: bool | None = None,
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find the effects that a model lacks, from a log.

    Args:
        log: measured runs, also as a path, a DataFrame or arrays by name.
        base: the base model, also as the path of a model.json; by default eqs. (4) and (6) of the paper, whose dead
            zone is then part of the model and not a candidate.
        holdout: validation data; by default some runs of the log, or the last part of a single run.
        fixed, bounds, prior: prior knowledge of parameters, as in `identification.fit`; also of parameters of candidate
            effects, `{"coulomb_friction.torque": (0.1, 0.3)}`.
        candidates: candidate effects, by their name in the catalogue or as classes, custom effects included. By default
            the whole catalogue.
        exclude: names of effects that are not candidates.
        inverse: whether to predict the torque from the motion, as for a robot in a tight loop. By default this is done
            where a model of the motion is refused or explains none of the torque. Where no effect explains the motion
            in a loop, a warning tells what it shows.
        force: diagnose also a log that is unusable (`Log.faults`).
        progress: called with a line of text at each step.

    Returns:
        Verdict, causes, the posterior over sets of effects, gain and the data of the plots.

    Raises:
        UnusableLog: the log or the validation data have faults that no model fits.
        BadParameter: base and log do not match, or an effect is unknown.
        Unidentifiable: the load does not move, or the fit of the base model failed.
    """
    log, effects = log_of(log).usable(force=force), chosen(candidates, exclude)
    start = base_model(log) if base is None else model_of(base)
    known = known_of(fixed, bounds, prior, start, effects.values(), stated=base is not None)
    tell = progress or (lambda line: None)
    given = None if holdout is None else log_of(holdout).usable(force=force)
    estimation, validation, notes = parts(log, given)
    if given is not None and (twice := fitted_too(log, given)) is not None:
        notes.append(f"{twice}: this run is fitted too, so it validates nothing; give another one.")

    def by_motion() -> Diagnosis:
        return _by_motion(log, (estimation, validation), start, known, effects, tell, notes, divided=given is None)

    def by_torque() -> Diagnosis:
        told = (start.on_the_load(), known, effects, tell, [*notes, _INVERSE])
        return diagnose_once((estimation, validation), *told, inverse=True)

    if inverse is not None:
        return by_torque() if inverse else by_motion()
    found, refusal = None, Unidentifiable()
    try:
        found = by_motion()
    except Unidentifiable as error:
        refusal = error
    if found is not None and (found.verdict != "unknown" or found.only_in_validation is not None):
        return found
    explained = found is not None and unexplained_torque(found.extended) is None
    if found is not None and explained and not torque_responds(log):  # an open loop is not tight
        return found
    tell("predicting the torque from the motion")
    with suppress(Unidentifiable):
        other = by_torque()
        if found is not None and explained:
            return replace(found, warnings=(*found.warnings, *_shown_by(other)))
        if other.torque_error.estimation_after**2 <= 1.0 - LIKELY:
            return other
    if found is None:
        raise refusal
    return found


def _shown_by(inverse: Diagnosis) -> tuple[str, ...]:
    """A sentence on the effects that an inverse model names for sure, if there are any.

    It is a hint only. If the loop is not tight, a disturbance moves the load, and the sizes are wrong; the log does not
    show how tight the loop was, but the user knows it.
    """
    sure = [title_of(cause.effect) for cause in inverse.causes if cause.probability > SURE]
    if not sure or inverse.verdict == "unknown":
        return ()
    return (
        f"Predicted from the motion instead (inverse model), the torque shows {joined_words(sure)} with a probability "
        "above 90 %. If it was measured in a tight loop, use that: --inverse (in Python inverse=True).",
    )


def _by_motion(
    log: Log,
    recorded: tuple[Log, Log],
    start: ServoModel,
    known: PriorKnowledge,
    effects: Mapping[str, type[Effect]],
    tell: Callable[[str], None],
    notes: Sequence[str],
    *,
    divided: bool,
) -> Diagnosis:
    """The diagnosis that predicts the motion; once more if an effect acts in the validation data only.

    Args:
        log: all data.
        recorded: estimation and validation data.
        start, known, effects, tell: as in `diagnose`.
        notes: warnings on how the data were divided.
        divided: whether they are parts of the log and may be divided otherwise.
    """
    validation = recorded[1]
    found = diagnose_once(recorded, start, known, effects, tell, notes)
    named = bool(found.causes) and found.only_in_validation is None
    beside = only_in_validation(found.extended, validation) if named and divided else None
    where = found.only_in_validation if beside is None else str(beside)
    if where is None:
        return found
    if is_of_parameters(found.extended, validation):
        changed = f"{where}; the model follows it with other values of its parameters."
        return replace(found, warnings=(*found.warnings, changed))
    alone = f"{where}: an effect acts there that the estimation data do not show."
    if divided and (other := split_otherwise(log)) is not None:
        why = f"{alone} So that part is used for estimation."
        tell(why)
        with suppress(Unidentifiable):
            again = diagnose_once(other[:2], start, known, effects, tell, [why, other[2]])
            if not named or len(again.causes) > len(found.causes):
                return again
    advice = f"{alone} Use that part for estimation and another one for validation."
    return replace(found, warnings=(*found.warnings, advice))
