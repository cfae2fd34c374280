"""What a machine answers frequency by frequency, and the second-order system that the paper reads from it."""

from frictionjax.frequency.frf import FRF as FRF
from frictionjax.frequency.frf import estimate_frf as estimate_frf
from frictionjax.frequency.sanathanan_koerner import SKResult as SKResult
from frictionjax.frequency.sanathanan_koerner import fit_sk as fit_sk
