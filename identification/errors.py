"""The exceptions of the identification package; the whole tree is drawn in `plant.errors`."""

from __future__ import annotations

from plant.errors import AntidriveError


class MalformedLog(AntidriveError, ValueError):
    """A measured log that cannot be used: the message says where it is wrong and what to do."""


class Unidentifiable(AntidriveError, ValueError):
    """The data do not determine a parameter that is needed."""


class UnusableLog(AntidriveError, ValueError):
    """A log that was read, but contradicts every machine: a reversed sign, degrees for radians, nothing that moves.

    The message is `Log.faults`; `force=True` goes on all the same.
    """


class MissingColumns(MalformedLog):
    """A log in which time, command or response were not recognised.

    The message lists the columns of the file, one a line; `options` would name those that are missing.
    """

    def __init__(self, message: str, options: str) -> None:
        """The message, and the options that a command line would need."""
        super().__init__(f"{message}\n{_NAME_THEM}{options}")
        self.options = options

    def with_command(self, command: str) -> str:
        """The message with the whole command to type."""
        return str(self).replace(f"{_NAME_THEM}{self.options}", f"{_NAME_THEM}{command} {self.options}")


_NAME_THEM = "Name them, for example: "
