"""Status of a step: reasons why it is not optimal, as numbers for machine code and as sentences."""

from __future__ import annotations

from enum import IntFlag
from functools import lru_cache


class Trouble(IntFlag):
    """Reasons why the result of a step is not optimal; several may apply at once."""

    NONE = 0
    NO_ANGLE = 1
    ANGLE_PREDICTED = 2
    ANGLE_JUMPED = 4
    ESTIMATE_RESTARTED = 8
    ESTIMATE_DIVERGED = 16
    NO_REFERENCE = 32
    UNCERTIFIED = 64
    CONTACT_AT_RISK = 128
    LIMIT_VIOLATED = 256
    NOT_FOLLOWING = 512
    ENCODER_FAULT = 1024


_SENTENCES = {
    Trouble.NO_ANGLE: "the angle is not a number",
    Trouble.ANGLE_PREDICTED: "the angle is not a number, the model's prediction is used",
    Trouble.ANGLE_JUMPED: "the angle jumped, the model's prediction is used",
    Trouble.ESTIMATE_RESTARTED: "the angle stayed away from the prediction, the estimate restarted",
    Trouble.ESTIMATE_DIVERGED: "the estimate diverged and restarted",
    Trouble.NO_REFERENCE: "the reference is not a number, the angle is held",
    Trouble.UNCERTIFIED: "the quadratic program was not solved, the last plan is followed",
    Trouble.CONTACT_AT_RISK: "max_torque is too low to keep contact at the predicted acceleration",
    Trouble.ENCODER_FAULT: "an encoder is contradicted (frozen, or unlike the others), the others are used",
    Trouble.LIMIT_VIOLATED: "a limit of angle or speed cannot be kept",
    Trouble.NOT_FOLLOWING: "the load does not follow the reference",
}


@lru_cache(maxsize=2 * max(Trouble))
def sentence(trouble: int) -> str:
    """The reasons in words, empty if there are none."""
    return "; ".join(words for reason, words in _SENTENCES.items() if reason & trouble)
