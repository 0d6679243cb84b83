"""A fit and a diagnosis to draw, with a label that would break a careless page."""

from __future__ import annotations

from dataclasses import replace

from front_door import PLAIN, columns

from diagnosis.diagnosis import Diagnosis
from diagnosis.residual_torque import residual_torque
from diagnosis.result import (
    Cause,
    EffectSet,
    Estimate,
    Gain,
    Minor,
    Rejected,
    Replay,
    TorqueError,
    Unexplained,
    Unknown,
)
from identification import Fit, Log, fit
from plant.effects import catalogue

_SIZES = {"coulomb_friction": ("torque",), "stribeck_friction": ("coulomb", "excess")}
_SHAPES = {"stribeck_friction": {"velocity": 0.1}}
HOSTILE = "</script><script>alert(1)</script> & <b>log</b>"


def sample_fit() -> Fit:
    """Of a plain servo."""
    return fit(Log.from_arrays(label=HOSTILE, **columns(PLAIN, duration=6.0)), PLAIN)


def sample_diagnosis(fitted: Fit) -> Diagnosis:
    """Of that fit, as if friction had been found."""
    run = fitted.log.runs[0]
    size = Estimate(value=0.4, std=0.01, unit="N m")
    cause = Cause(
        effect="coulomb_friction",
        probability=0.97,
        alternatives=(("stribeck_friction", 0.02),),
        parameters={"torque": size},
        share=0.6,
        rms=0.35,
        gain=0.8,
        gain_std=0.1,
        log_bayes=321.0,
    )
    names = (("coulomb_friction",), ("stribeck_friction",), ())
    sets = tuple(
        EffectSet(effects=each, unknown=("velocity",), probability=p, log_marginal=-place, fit=_with(fitted, each))
        for place, (each, p) in enumerate(zip(names, (0.97, 0.02, 0.01), strict=True))
    )
    missing = residual_torque(fitted)
    return Diagnosis(
        verdict="named",
        causes=(cause,),
        minor=(Minor(effect="cogging", probability=0.3, share=0.01, rms=0.002),),
        sets=sets,
        without={"coulomb_friction": fitted},
        unknown=Unknown(probability=0.7, measurement_error=0.1, depends_on=("velocity",), share=0.02),
        rejected=(Rejected(effect="input_delay", reason="it costs more than it explains (log Bayes factor -3.2)"),),
        gain=Gain(
            held_out_rms_before=0.05,
            held_out_rms_after=0.01,
            noise_floor=0.001,
            unit="rad",
            window=None,
            runs=(HOSTILE,),
        ),
        torque_error=TorqueError(
            cutoff=5.0,
            estimation_before=0.18,
            estimation_after=0.04,
            held_out_before=0.19,
            held_out_after=0.06,
            std={
                "estimation_before": 0.01,
                "estimation_after": 0.002,
                "held_out_before": 0.01,
                "held_out_after": 0.004,
            },
        ),
        unexplained=Unexplained(share=0.02, depends_on=("velocity",)),
        warnings=("a warning about " + HOSTILE,),
        base=fitted,
        extended=replace(fitted),
        residual_before=missing,
        residual_after=missing,
        replays=(
            Replay(
                label=HOSTILE,
                time=run.time,
                measured=run.output,
                before=run.output + 0.01,
                after=run.output + 0.001,
                valid=run.valid,
            ),
        ),
        whiteness=0.01,
    )


def _with(fitted: Fit, names: tuple[str, ...]) -> Fit:
    """The fit as if it had effects, which do nothing."""
    model = fitted.model
    for name in names:
        model = model.with_effect(catalogue[name](**dict.fromkeys(_SIZES[name], 0.0), **_SHAPES.get(name, {})))
    return replace(fitted, model=model)
