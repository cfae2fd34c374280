"""Simulation: the fixed-step scheme for sampled data, the diffrax reference, observers and windowed prediction."""

from frictionjax.simulation.batch import simulate_batch as simulate_batch
from frictionjax.simulation.closed_loop import simulate_closed_loop as simulate_closed_loop
from frictionjax.simulation.disturbance import residual_force as residual_force
from frictionjax.simulation.disturbance import residual_force_std as residual_force_std
from frictionjax.simulation.fixed import Trajectory as Trajectory
from frictionjax.simulation.fixed import simulate as simulate
from frictionjax.simulation.imposed import simulate_imposed as simulate_imposed
from frictionjax.simulation.observer import ObservedMotion as ObservedMotion
from frictionjax.simulation.observer import ObserverGains as ObserverGains
from frictionjax.simulation.observer import innovation_gain as innovation_gain
from frictionjax.simulation.observer import innovations as innovations
from frictionjax.simulation.observer import left_by_observer as left_by_observer
from frictionjax.simulation.observer import left_by_varying_observer as left_by_varying_observer
from frictionjax.simulation.observer import observe as observe
from frictionjax.simulation.observer import observer_gains as observer_gains
from frictionjax.simulation.observer import sensor_noise as sensor_noise
from frictionjax.simulation.prediction import predict_ahead as predict_ahead
from frictionjax.simulation.reference import simulate_reference as simulate_reference
