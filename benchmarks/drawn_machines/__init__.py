"""Logs of randomly drawn servos: drawn from a seed, simulated with independent equations."""

from __future__ import annotations

from drawn_machines.drawn import Drawn, Hidden, drawn

__all__ = ["Drawn", "Hidden", "drawn"]
