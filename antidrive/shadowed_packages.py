"""The packages of antidrive have plain names; a module of the user with the same name would replace them."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("plant", "allocation", "identification", "diagnosis", "mpc")


def refuse_shadowing() -> None:
    """Raise `ImportError` if Python would find another module by the name of one of the packages."""
    home = Path(__file__).resolve().parents[1]
    for name in PACKAGES:
        found = _place(name)
        if found is not None and found.resolve() != home / name / "__init__.py":
            raise ImportError(
                f"{found} stands in the way of antidrive's own package '{name}': give it another name, "
                f"for example my_{name}{found.suffix}, or run Python from another folder."
            )


def _place(name: str) -> Path | None:
    """The file that `import name` would run, or has run."""
    if name in sys.modules:
        file = getattr(sys.modules[name], "__file__", None)
    else:
        spec = find_spec(name)
        file = None if spec is None else spec.origin
    return None if file is None else Path(file)
