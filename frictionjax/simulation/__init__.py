"""Simulation: the fixed-step scheme for sampled data, the diffrax reference, observers and windowed prediction."""

from frictionjax.simulation.fixed import Trajectory as Trajectory
from frictionjax.simulation.fixed import simulate as simulate
from frictionjax.simulation.observer import Gains as Gains
from frictionjax.simulation.observer import Observed as Observed
from frictionjax.simulation.observer import innovation_gain as innovation_gain
from frictionjax.simulation.observer import innovations as innovations
from frictionjax.simulation.observer import observe as observe
from frictionjax.simulation.observer import observer_gains as observer_gains
