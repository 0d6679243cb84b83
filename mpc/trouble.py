"""What can go wrong in a step, as a number for machine code and as a sentence for people."""

from __future__ import annotations

from enum import IntFlag
from functools import lru_cache


class Trouble(IntFlag):
    """Reasons why a control is not optimal; several may hold at once."""

    NONE = 0
    LOST = 1
    BRIDGED = 2
    JUMPED = 4
    STAYED = 8
    DIVERGED = 16
    AIMLESS = 32
    UNCERTIFIED = 64
    PARTING = 128
    BEYOND = 256
    ASTRAY = 512
    CONTRADICTED = 1024


_SENTENCES = {
    Trouble.LOST: "the angle is not a number",
    Trouble.BRIDGED: "the angle is not a number, the model's prediction is used",
    Trouble.JUMPED: "the angle jumped, the model's prediction is used",
    Trouble.STAYED: "the angle stayed away from the prediction, the estimate restarted",
    Trouble.DIVERGED: "the estimate diverged and restarted",
    Trouble.AIMLESS: "the reference is not a number, the angle is held",
    Trouble.UNCERTIFIED: "the quadratic program was not solved, the last plan is followed",
    Trouble.PARTING: "max_torque is too low to keep contact at the predicted acceleration",
    Trouble.CONTRADICTED: "an encoder is contradicted (frozen, or unlike the others), the others are used",
    Trouble.BEYOND: "a limit of angle or speed cannot be kept",
    Trouble.ASTRAY: "the load does not follow the reference",
}


@lru_cache(maxsize=2 * max(Trouble))
def sentence(trouble: int) -> str:
    """The reasons in words, empty if there are none."""
    return "; ".join(words for reason, words in _SENTENCES.items() if reason & trouble)
