"""The program: the same public verbs, no maths. Imports of the package stand inside functions in this one folder: JAX
takes more than a second to load, and `--help`, `--version` and a mistyped option must answer at once.
"""

from frictionjax.cli.program import main as main
