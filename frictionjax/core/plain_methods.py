"""Modules whose methods are Python's own: quick to ask for."""


class PlainMethods:
    """To be inherited beside `equinox.Module`, by what is asked for its methods many thousand times.

    Equinox makes a Module of each method when it is asked for, so that it can be given to `jax.jit`. Making one walks
    through all arrays of its object: a fit spent a sixth of Python's time on that. A method of these classes cannot be
    an argument of a transformed function; a function that calls it can.
    """

    __slots__ = ()
    __getattribute__ = object.__getattribute__
