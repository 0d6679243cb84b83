"""The user's prior knowledge of a model's parameters: fixed values, bounds, and Gaussian priors."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from plant.effects.effect import Parameter
from plant.errors import BadParameter
from plant.number import finite
from plant.servo import ServoModel
from plant.suggestion import suggestion

Fixed: TypeAlias = "Collection[str] | Mapping[str, float] | Mapping[str, float | None]"
Pairs: TypeAlias = "Mapping[str, tuple[float, float]]"


@dataclass(frozen=True, kw_only=True)
class PriorKnowledge:
    """Numbers by parameter name, in the unit of the parameter; a model need not have all the parameters.

    Attributes:
        fixed: parameters that are not fitted, with their value; None keeps the value of the model.
        bounds: least and greatest value, within the physical bounds of the parameter.
        prior: mean and standard deviation of a Gaussian.
    """

    fixed: Mapping[str, float | None] = field(default_factory=dict)
    bounds: Pairs = field(default_factory=dict)
    prior: Pairs = field(default_factory=dict)

    @classmethod
    def of(
        cls, fixed: Fixed, bounds: Pairs | None, prior: Pairs | None, parameters: Iterable[Parameter]
    ) -> PriorKnowledge:
        """The user's knowledge of some of these parameters, checked.

        Raises:
            BadParameter: no parameter has the name, or the parameter cannot have the numbers.
        """
        specs = {spec.name: spec for spec in parameters}
        values = (
            dict(fixed) if isinstance(fixed, Mapping) else dict.fromkeys([fixed] if isinstance(fixed, str) else fixed)
        )
        given: dict[str, Mapping[str, object]] = {"fixed": values, "bounds": bounds or {}, "prior": prior or {}}
        for what, numbers in given.items():
            for name in numbers:
                if name not in specs:
                    raise BadParameter(f"{what}: {name!r} is not a parameter; {suggestion(name, specs)}")
                if what != "fixed" and name in values:
                    raise BadParameter(f"{what}: {name} is fixed; leave it out of {what}, or of fixed.")
        return cls(
            fixed={name: None if value is None else _fixed(specs[name], value) for name, value in values.items()},
            bounds={name: _bounds(specs[name], pair) for name, pair in given["bounds"].items()},
            prior={name: _prior(specs[name], pair) for name, pair in given["prior"].items()},
        )

    def held(self, model: ServoModel) -> ServoModel:
        """The model with the fixed values."""
        return _with(model, {name: value for name, value in self.fixed.items() if value is not None})

    def keeping(self, kept: Iterable[str], names: Collection[str]) -> PriorKnowledge:
        """The knowledge for fits of models near one with parameters `names`; the parameters `kept` keep their value."""
        stated = {name: value for name, value in self.fixed.items() if value is not None or name in names}
        return replace(self, fixed={**dict.fromkeys(kept), **stated})

    def begun(self, model: ServoModel) -> ServoModel:
        """The model from which a fit starts: with the fixed values, at the means of the priors, within the bounds."""
        model = _with(self.held(model), {name: mean for name, (mean, _) in self.prior.items()})
        own = dict(zip(model.names, model.values, strict=True))
        inside = {name: np.clip(own[name], *pair) for name, pair in self.bounds.items() if name in own}
        return _with(model, inside)


def _with(model: ServoModel, numbers: Mapping[str, float]) -> ServoModel:
    values = [numbers.get(name, value) for name, value in zip(model.names, model.values, strict=True)]
    return model.with_values(values) if set(numbers) & set(model.names) else model


def _fixed(spec: Parameter, value: object) -> float:
    return spec.check("fixed", value)


def _bounds(spec: Parameter, pair: object) -> tuple[float, float]:
    lower, upper = _pair("bounds", spec, pair, "(least, greatest)")
    if not lower < upper:
        raise BadParameter(f"bounds: {spec.name} = {lower:g} .. {upper:g}: the first must be below the second.")
    return spec.check("bounds", lower), spec.check("bounds", upper)


def _prior(spec: Parameter, pair: object) -> tuple[float, float]:
    mean, std = _pair("prior", spec, pair, "(mean, standard deviation)")
    if not std > 0.0:
        raise BadParameter(
            f"prior: {spec.name}: the standard deviation must be above zero, not {std:g}; fix it instead."
        )
    return spec.check("prior", mean), std


def _pair(what: str, spec: Parameter, pair: object, meaning: str) -> tuple[float, float]:
    numbers = [finite(number) for number in pair] if isinstance(pair, Iterable) else []
    if len(numbers) != 2 or numbers[0] is None or numbers[1] is None:
        raise BadParameter(f"{what}: {spec.name} needs two finite numbers {meaning}, not {pair!r}.")
    return numbers[0], numbers[1]
