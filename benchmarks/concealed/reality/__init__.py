"""A reality to diagnose: servo machines with known, concealed physics, that share no code with the library under test.

`make_case` simulates one machine and its recordings, `write_case` puts them into a folder as a case file and CSVs.
Nothing here imports the library or JAX: equations, solver and experiments are this package's own.
"""

from .cases import SimulatedCase, make_case, write_case
from .effects import CATALOGUE, EFFECTS, EXTRA, OUTSIDE
from .experiments import FAMILIES
from .plants import Plant, draw_plant

__all__ = [
    "CATALOGUE",
    "EFFECTS",
    "EXTRA",
    "FAMILIES",
    "OUTSIDE",
    "Plant",
    "SimulatedCase",
    "draw_plant",
    "make_case",
    "write_case",
]
