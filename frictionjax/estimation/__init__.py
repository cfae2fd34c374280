"""Starting values, the joint fit of all recordings, its uncertainty."""

from frictionjax.estimation.fit import FitResult as FitResult
from frictionjax.estimation.fit import fit as fit
from frictionjax.estimation.start import Start as Start
from frictionjax.estimation.start import starting_values as starting_values
