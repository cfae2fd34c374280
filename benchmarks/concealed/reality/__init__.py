"""A reality to diagnose: servo machines with known, concealed physics, that share no code with the library under test.

`make_case` simulates one machine and its recordings, `write_case` puts them into a folder as a case file and CSVs.
Nothing here imports the library or JAX: equations, solver and experiments are this package's own.
"""

from .cases import SimulatedCase, make_case, write_case
from .effects import CATALOGUE, EFFECTS, EXTRA, OUTSIDE, STRENGTHS
from .effects_outside import RANDOM
from .experiments import FAMILIES
from .families import RECIPES, rate_of
from .plants import Plant, draw_plant
from .visibility import visibility

__all__ = [
    "CATALOGUE",
    "EFFECTS",
    "EXTRA",
    "FAMILIES",
    "OUTSIDE",
    "RANDOM",
    "RECIPES",
    "STRENGTHS",
    "Plant",
    "SimulatedCase",
    "draw_plant",
    "make_case",
    "rate_of",
    "visibility",
    "write_case",
]
