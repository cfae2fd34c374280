"""What a machine answers frequency by frequency, and the second-order system that the paper reads from it."""

from frictionjax.frequency.bla import BLA as BLA
from frictionjax.frequency.bla import Detection as Detection
from frictionjax.frequency.bla import best_linear_approximation as best_linear_approximation
from frictionjax.frequency.extrapolation import ZeroAmplitude as ZeroAmplitude
from frictionjax.frequency.extrapolation import extrapolate_to_zero_amplitude as extrapolate_to_zero_amplitude
from frictionjax.frequency.frf import FRF as FRF
from frictionjax.frequency.frf import estimate_frf as estimate_frf
from frictionjax.frequency.resonances import Resonances as Resonances
from frictionjax.frequency.resonances import resonances as resonances
from frictionjax.frequency.sanathanan_koerner import SKResult as SKResult
from frictionjax.frequency.sanathanan_koerner import fit_sk as fit_sk
