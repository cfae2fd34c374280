"""The checker of types at run time, as Python's typing has it: an `int` is a `float`, too (PEP 484)."""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
