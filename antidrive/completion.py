"""Completions that the shell offers for an incomplete word."""

from __future__ import annotations

from importlib.resources import files

DATASETS = ("emps", "kscale", "bam", "ur10e", "hsm150")
TABLES = ("friction", "cogging", "gravity", "position-error", "dead-zone", "backlash", "dead-time")


def tables(begun: str) -> list[str]:
    """Kinds of drive tables."""
    return [name for name in TABLES if name.startswith(begun)]


def datasets(begun: str) -> list[str]:
    """Names of known data sets."""
    return [name for name in DATASETS if name.startswith(begun)]


def scenarios(begun: str) -> list[str]:
    """Names of the scenarios in the package."""
    names = (file.name.removesuffix(".toml") for file in files("antidrive").joinpath("scenarios").iterdir())
    return sorted(name for name in names if name.startswith(begun))


def effects(begun: str) -> list[str]:
    """Names of the catalogue's effects."""
    from plant.effects import catalogue

    return [name for name in catalogue if name.startswith(begun)]
