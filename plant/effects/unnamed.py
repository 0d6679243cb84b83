"""All that a model may carry without a name: curves, laws whose size varies, and ripples."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from plant.effects.curve import Unnamed, curves
from plant.effects.ripple import ripples
from plant.effects.varying import varying

plain: Mapping[str, type[Unnamed]] = curves
"""A torque over one variable, by name."""

unnamed: Mapping[str, type[Unnamed]] = MappingProxyType({**plain, **varying, **ripples})
"""All of them, by name."""
