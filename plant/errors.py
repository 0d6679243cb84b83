"""The exceptions of antidrive.

    AntidriveError              base of all errors that a user can cause or should know
    ├── BadParameter            a number, name or option that cannot be used        (plant)
    ├── BadModelFile            a model.json that cannot be read                    (plant)
    ├── MalformedLog            a measured log that cannot be used                  (identification)
    ├── UnusableLog             a readable log that contradicts every machine       (identification)
    ├── Unidentifiable          the data do not determine a parameter               (identification)
    └── InfeasibleTorque        no allocation of the torque satisfies the constraints    (allocation)

The message is one sentence: the fault, its place, and the remedy. The command line prints it and exits with code 2.
"""

from __future__ import annotations


class AntidriveError(Exception):
    """Base of all errors that antidrive raises on purpose."""


class BadParameter(AntidriveError, ValueError):
    """A parameter, name or option that cannot be used."""


class BadModelFile(AntidriveError):
    """A model file that cannot be read as a `ServoModel`."""
