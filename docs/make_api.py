"""API reference of the whole package, from its docstrings: `python docs/make_api.py FOLDER`.

A page a module, with search and sources; it opens offline. Generated code has none. What pdoc
warns of (an annotation that cannot be resolved, a module that cannot be imported) is an error.
Where rclpy is missing the nodes are left out, and this is said. `FOLDER MODULE ...`: only of some.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import sys
import warnings
from dataclasses import is_dataclass
from pathlib import Path
from typing import get_type_hints

import pdoc
from pdoc.extract import walk_specs

import delta_calibration

ROS = "delta_calibration.ros"
GENERATED = "delta_calibration.model.generated"


def modules() -> list[str]:
    """Every module of the package; those of nodes only where they can be imported."""
    package = delta_calibration.__name__
    left_out = [f"!{GENERATED}"]
    if importlib.util.find_spec("rclpy") is None:
        sys.stderr.write(f"no rclpy: without {ROS}\n")
        left_out.append(f"!{ROS}")
    # pdoc finds by itself what no `__all__` leaves out
    found = {*walk_specs([package, *left_out])}
    every = pkgutil.walk_packages(delta_calibration.__path__, f"{package}.")
    names = [item.name for item in every]
    without = tuple(f"{name[1:]}." for name in left_out)
    kept = [name for name in names if not f"{name}.".startswith(without)]
    return [package, *(name for name in kept if name not in found), *left_out]


def resolve_fields(names: list[str]) -> None:
    """Let the constructors of dataclasses and named tuples name types, not texts.

    A field's annotation is a text in the words of the module where the field stands; a class that
    inherits it elsewhere, and the constructor Python writes for a named tuple, have the text and
    not the words.
    """
    for name in names:
        for kind in vars(importlib.import_module(name)).values():
            if not isinstance(kind, type):
                continue
            if is_dataclass(kind) and "__init__" in vars(kind):
                texts = kind.__init__.__annotations__
            elif issubclass(kind, tuple) and hasattr(kind, "_fields"):
                texts = kind.__new__.__annotations__
            else:
                continue
            types = get_type_hints(kind)
            texts.update({field: types[field] for field in texts if field in types})


def main(folder: Path, names: list[str], sources: bool = True) -> None:
    """Write the pages of some modules; to colour the sources takes half of the time."""
    with warnings.catch_warnings():
        # of pdoc only: what other libraries deprecate among themselves is not ours
        warnings.filterwarnings("error", category=UserWarning)
        footer = f"{delta_calibration.__version__}"
        pdoc.render.configure(docformat="google", footer_text=footer, show_source=sources)
        resolve_fields([*walk_specs(names)])
        pdoc.pdoc(*names, output_directory=folder)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/docs"), sys.argv[2:] or modules())
