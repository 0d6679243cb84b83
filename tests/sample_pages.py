"""A fit and a diagnosis to draw, with a label that would break a careless page."""

from __future__ import annotations

from dataclasses import replace

from front_door import PLAIN, columns

from diagnosis.diagnosis import Diagnosis
from diagnosis.residual_torque import residual_torque
from diagnosis.result import (
    Candidate,
    Cause,
    EffectSet,
    Estimate,
    Gain,
    Replay,
    TorqueError,
    Unexplained,
    Unknown,
)
from identification import Fit, Log, fit

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
        alternatives=(("stribeck_friction", 0.02), ("none", 0.01)),
        parameters={"torque": size},
        gain=0.8,
        evidence=321.0,
    )
    candidate = Candidate(
        round=1,
        effect="coulomb_friction",
        evidence=321.0,
        score=311.0,
        visible=315.0,
        probability=0.97,
        refitted=True,
        parameters={"torque": size},
    )
    missing = residual_torque(fitted)
    return Diagnosis(
        verdict="named",
        causes=(cause,),
        minor=(),
        sets=(
            EffectSet(effects=("coulomb_friction",), unknown=("velocity",), probability=0.97),
            EffectSet(effects=("stribeck_friction",), unknown=("velocity",), probability=0.02),
        ),
        unknown=Unknown(probability=0.8, depends_on=("velocity",), share=0.01),
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
        candidates=(candidate,),
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
