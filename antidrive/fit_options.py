"""A user's settings for parameters and effects: options of `identify` and `diagnose`, and `[fit]` of a log.toml."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeAlias

from plant.effects import Effect
from plant.errors import BadParameter

Pair: TypeAlias = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Prior knowledge for a fit, and the candidate effects of a diagnosis; empty if nothing is given.

    Attributes:
        fixed: parameters that are not fitted, with their value or None for that of the model.
        bounds: least and greatest value by parameter.
        prior: mean and standard deviation by parameter.
        per_run: parameters with a separate value in each run; for a fit, not for a diagnosis.
        exclude, candidates: names of effects.
        effects: a file that defines custom effects.
        inverse: whether a diagnosis predicts the torque from the motion; None if it decides itself.
    """

    fixed: Mapping[str, float | None] = field(default_factory=dict)
    bounds: Mapping[str, Pair] = field(default_factory=dict)
    prior: Mapping[str, Pair] = field(default_factory=dict)
    per_run: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    effects: Path | None = None
    inverse: bool | None = None

    @classmethod
    def typed(
        cls,
        *,
        fixed: Sequence[str] | None = None,
        bounds: Sequence[str] | None = None,
        prior: Sequence[str] | None = None,
        per_run: Sequence[str] | None = None,
        exclude: Sequence[str] | None = None,
        candidates: Sequence[str] | None = None,
        effects: Path | None = None,
        inverse: bool | None = None,
    ) -> FitOptions:
        """From the words of a command line: `inertia`, `inertia=0.1:0.3`, `cogging,backlash`.

        Raises:
            BadParameter: a word with a wrong form.
        """
        return cls(
            fixed=_by_name("--fixed", _split("--fixed", fixed), _maybe, "inertia=0.2"),
            bounds=_by_name("--bounds", _split("--bounds", bounds), _pair, "inertia=0.1:0.3"),
            prior=_by_name("--prior", _split("--prior", prior), _pair, "inertia=0.2:0.05"),
            per_run=tuple(_split("--per-run", per_run)),
            exclude=tuple(_split("--exclude", exclude)),
            candidates=tuple(_split("--candidates", candidates)),
            effects=effects,
            inverse=inverse,
        )

    @classmethod
    def of(cls, table: Mapping[str, Any], folder: Path = Path()) -> FitOptions:
        """From the section [fit] of a log.toml in that folder.

            [fit]
            fixed = ["gravity", "inertia=0.2"]
            bounds = { inertia = [0.1, 0.3] }
            prior = { viscous_friction = [0.2, 0.05] }
            exclude = ["backlash"]
            effects = "my_effect.py"
            inverse = true

        Raises:
            BadParameter: an unknown key, or a value of the wrong kind.
        """
        keys = [each.name for each in fields(cls)]
        unknown = sorted(set(table) - set(keys))
        if unknown:
            raise BadParameter(f"[fit] has no {unknown[0]!r}; it may have {', '.join(keys)}.")
        effects = table.get("effects")
        if effects is not None and not isinstance(effects, str):
            raise BadParameter(f"[fit] effects must be the path of a Python file, not {effects!r}.")
        inverse = table.get("inverse")
        if inverse is not None and not isinstance(inverse, bool):
            raise BadParameter(f"[fit] inverse must be true or false, not {inverse!r}.")
        return cls(
            fixed=_by_name("[fit] fixed", _names(table, "fixed"), _maybe, "inertia=0.2"),
            bounds=_pairs(table, "bounds"),
            prior=_pairs(table, "prior"),
            per_run=_names(table, "per_run"),
            exclude=_names(table, "exclude"),
            candidates=_names(table, "candidates"),
            effects=None if effects is None else folder / effects,
            inverse=inverse,
        )

    def merged(self, other: FitOptions) -> FitOptions:
        """These options, overridden by others: parameter by parameter, or list by list."""
        given = {*other.fixed, *other.bounds, *other.prior}  # a parameter that is fixed now has no prior
        return FitOptions(
            fixed=_kept(self.fixed, given) | dict(other.fixed),
            bounds=_kept(self.bounds, {*other.fixed, *other.bounds}) | dict(other.bounds),
            prior=_kept(self.prior, {*other.fixed, *other.prior}) | dict(other.prior),
            per_run=other.per_run or self.per_run,
            exclude=other.exclude or self.exclude,
            candidates=other.candidates or self.candidates,
            effects=other.effects or self.effects,
            inverse=self.inverse if other.inverse is None else other.inverse,
        )

    def own_effects(self) -> tuple[type[Effect], ...]:
        """The custom effects.

        Raises:
            BadParameter: as `own_effects.read_effects` does.
        """
        from antidrive.own_effects import read_effects

        return () if self.effects is None else read_effects(self.effects)

    def choice(self, own: Iterable[type[Effect]]) -> list[str | type[Effect]] | None:
        """Candidates of a diagnosis: the given ones, else catalogue and custom effects; None is the catalogue alone."""
        from plant.effects import catalogue

        by_name = {kind.name: kind for kind in own}
        if not self.candidates:
            return [*catalogue, *by_name.values()] if by_name else None
        return [by_name.get(name, name) for name in self.candidates]


def _split(option: str, words: Sequence[str] | None) -> list[str]:
    parts = [part.strip() for word in words or () for part in word.split(",") if part.strip()]
    if words and not parts:
        raise BadParameter(f"{option} is empty; give a name, or leave it out.")
    return parts


def _by_name(option: str, words: Iterable[str], read: Callable[[str], Any], example: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for word in words:
        name, equals, text = (part.strip() for part in word.partition("="))
        if name in found:
            raise BadParameter(f"{option} names {name!r} twice; give it once.")
        try:
            found[name] = read(text if equals else "")
        except ValueError:
            raise BadParameter(f"{option} {word!r}: write it as in {option} {example}.") from None
    return found


def _maybe(text: str) -> float | None:
    return float(text) if text else None


def _pair(text: str) -> Pair:
    first, second = text.split(":")
    return float(first), float(second)


def _names(table: Mapping[str, Any], key: str) -> tuple[str, ...]:
    given = table.get(key, [])
    given = [given] if isinstance(given, str) else given
    if not (isinstance(given, list) and all(isinstance(name, str) for name in given)):
        raise BadParameter(f'[fit] {key} must be a list of names, as in {key} = ["gravity"], not {given!r}.')
    return tuple(given)


def _pairs(table: Mapping[str, Any], key: str) -> dict[str, Pair]:
    given = table.get(key, {})
    if not isinstance(given, Mapping):
        raise BadParameter(f"[fit] {key} must be a table, as in {key} = {{ inertia = [0.1, 0.3] }}, not {given!r}.")
    # coulomb_friction.torque without quotes is a table within a table
    flat = {
        ".".join((name, *inner)): pair
        for name, entry in given.items()
        for inner, pair in ([((key,), p) for key, p in entry.items()] if isinstance(entry, Mapping) else [((), entry)])
    }
    for name, pair in flat.items():
        if not (isinstance(pair, list) and len(pair) == 2):
            raise BadParameter(f"[fit] {key}: write {name} = [0.1, 0.3], not {pair!r}.")
    return {name: (pair[0], pair[1]) for name, pair in flat.items()}


def _kept(mine: Mapping[str, Any], given: set[str]) -> dict[str, Any]:
    return {name: value for name, value in mine.items() if name not in given}
