"""The paper's own experiments, one file each: settings from a scenario file, numbers, and conclusions."""

from __future__ import annotations
