"""The front door: command line, report, scenarios and the demo."""

from antidrive.version import VERSION as __version__

__all__ = ["__version__"]
