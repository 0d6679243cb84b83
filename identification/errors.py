"""The exceptions of the identification package; the whole tree is drawn in `plant.errors`."""

from __future__ import annotations

from plant.errors import AntidriveError


class MalformedLog(AntidriveError, ValueError):
    """A measured log that cannot be used: the message says where it is wrong and what to do."""


class Unidentifiable(AntidriveError, ValueError):
    """The data cannot tell a parameter that was asked for."""


class UnusableLog(AntidriveError, ValueError):
    """A log that was read, but contradicts every machine: a reversed sign, degrees for radians, nothing that moves.

    The message is `Log.faults`; `force=True` goes on all the same.
    """
