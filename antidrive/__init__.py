"""The front door: command line, report, scenarios and the demo."""
