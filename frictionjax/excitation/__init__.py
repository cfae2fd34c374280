"""Excitation signals that show a machine's friction: noise, multisines, ramps, presliding loops, moves.

Every signal has the shape `(n,)`, one value a sample, to be held until the next. Random ones take a key of
`jax.random`; `jax.vmap` over keys gives independent realisations. Times are in s, frequencies in Hz, levels in the
unit of whatever the signal drives: volts, newtons, or a position to follow.
"""

from frictionjax.excitation.gaussian_noise import gaussian_noise as gaussian_noise
from frictionjax.excitation.multisine import multisine as multisine
from frictionjax.excitation.multisine_lines import MultisineLines as MultisineLines
from frictionjax.excitation.multisine_lines import multisine_lines as multisine_lines
from frictionjax.excitation.multisine_lines import silent_lines as silent_lines
from frictionjax.excitation.point_to_point import point_to_point as point_to_point
from frictionjax.excitation.prbs import prbs as prbs
from frictionjax.excitation.presliding_loop import presliding_loop as presliding_loop
from frictionjax.excitation.ramp import ramp as ramp
