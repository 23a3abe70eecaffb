"""Import of the optional libraries of reports, with advice on what to install."""

from __future__ import annotations

import importlib
from typing import Any

from delta_calibration.errors import InputError


def required(module: str, purpose: str = "a report") -> Any:
    """Import an optional library.

    Raises:
        InputError: it is not installed; says what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise InputError(
            f"{purpose} needs {name}, which this Python does not have: "
            "pip install 'delta_calibration[report]', or sudo apt install "
            f"python3-{name}"
        ) from error


def require_libraries() -> None:
    """Check that the libraries for a page are installed, before the work begins.

    Raises:
        InputError: a library is not installed; says what to install.
    """
    for module in ("jinja2", "plotly"):
        required(module)
