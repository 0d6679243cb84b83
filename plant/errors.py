"""The exceptions of antidrive.

    AntidriveError              everything that a user can cause or should know
    ├── BadParameter            a number, name or option that cannot be used        (plant)
    ├── BadModelFile            a model.json that cannot be read                    (plant)
    ├── MalformedLog            a measured log that cannot be used                  (identification)
    ├── UnusableLog             a log that was read but contradicts every machine   (identification)
    ├── Unidentifiable          the data cannot tell a parameter                    (identification)
    └── InfeasibleTorque        no split of the torque satisfies the constraints    (allocation)

The message is one sentence: what is wrong, where, and what to do.
The command line prints it and exits with code 2.
"""

from __future__ import annotations


class AntidriveError(Exception):
    """Base of all errors that antidrive raises on purpose."""


class BadParameter(AntidriveError, ValueError):
    """A parameter, name or option that cannot be used."""


class BadModelFile(AntidriveError):
    """A model file that cannot be read as a `ServoModel`."""
