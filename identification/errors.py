"""The exceptions of the identification package; `plant.errors` shows the whole tree."""

from __future__ import annotations

from plant.errors import AntidriveError


class MalformedLog(AntidriveError, ValueError):
    """A measured log that cannot be used; the message gives the place of the error and the remedy."""


class Unidentifiable(AntidriveError, ValueError):
    """The data do not determine a parameter that is needed."""


class UnusableLog(AntidriveError, ValueError):
    """A log that was read, but that no machine can produce: a reversed sign, degrees for radians, or no motion.

    The message is from `Log.faults`; `force=True` continues in spite of it.
    """


class MissingColumns(MalformedLog):
    """A log in which time, command or response were not recognised.

    The message lists the columns of the file, one a line; `options` are command-line options for the missing ones.
    """

    def __init__(self, message: str, options: str) -> None:
        """The message, and the command-line options that name the missing columns."""
        super().__init__(f"{message}\n{_NAME_THEM}{options}")
        self.options = options

    def with_command(self, command: str) -> str:
        """The message with the complete command line."""
        return str(self).replace(f"{_NAME_THEM}{self.options}", f"{_NAME_THEM}{command} {self.options}")


_NAME_THEM = "Name them, for example: "
