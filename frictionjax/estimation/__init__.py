"""Starting values, the joint fit of all data, its noise and its uncertainty."""

from frictionjax.estimation.fit import fit as fit
from frictionjax.estimation.loss import AbstractLoss as AbstractLoss
from frictionjax.estimation.loss import Cauchy as Cauchy
from frictionjax.estimation.loss import Gaussian as Gaussian
from frictionjax.estimation.loss import Huber as Huber
from frictionjax.estimation.observation import Observation as Observation
from frictionjax.estimation.profile import Bootstrap as Bootstrap
from frictionjax.estimation.profile import Profile as Profile
from frictionjax.estimation.profile import bootstrap as bootstrap
from frictionjax.estimation.profile import profile_likelihood as profile_likelihood
from frictionjax.estimation.replicas import Replicas as Replicas
from frictionjax.estimation.replicas import fit_many as fit_many
from frictionjax.estimation.result import FitResult as FitResult
from frictionjax.estimation.result import RecordingNoise as RecordingNoise
from frictionjax.estimation.start import Start as Start
from frictionjax.estimation.start import starting_values as starting_values
