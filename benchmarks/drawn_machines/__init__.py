"""Logs of servos that nobody chose: drawn from a seed, simulated by equations of their own."""

from __future__ import annotations

from drawn_machines.drawn import Drawn, Hidden, drawn

__all__ = ["Drawn", "Hidden", "drawn"]
