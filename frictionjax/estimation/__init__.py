"""Starting values, the joint fit of all data, its noise and its uncertainty."""

from typing import TYPE_CHECKING

from frictionjax.core.late_door import late_door

if TYPE_CHECKING:
    from frictionjax.estimation.data.observation import Observation as Observation
    from frictionjax.estimation.fit import fit as fit
    from frictionjax.estimation.fit_many import Replicas as Replicas
    from frictionjax.estimation.fit_many import fit_many as fit_many
    from frictionjax.estimation.objective.loss import AbstractLoss as AbstractLoss
    from frictionjax.estimation.objective.loss import Cauchy as Cauchy
    from frictionjax.estimation.objective.loss import Gaussian as Gaussian
    from frictionjax.estimation.objective.loss import Huber as Huber
    from frictionjax.estimation.profile import Bootstrap as Bootstrap
    from frictionjax.estimation.profile import Profile as Profile
    from frictionjax.estimation.profile import bootstrap as bootstrap
    from frictionjax.estimation.profile import profile_likelihood as profile_likelihood
    from frictionjax.estimation.result import FitResult as FitResult
    from frictionjax.estimation.result import RecordingNoise as RecordingNoise
    from frictionjax.estimation.start.driven import StartingValues as StartingValues
    from frictionjax.estimation.start.driven import starting_values as starting_values

late_door(
    __name__,
    {
        "Observation": "data.observation",
        "fit": "fit",
        "Replicas": "fit_many",
        "fit_many": "fit_many",
        "AbstractLoss": "objective.loss",
        "Cauchy": "objective.loss",
        "Gaussian": "objective.loss",
        "Huber": "objective.loss",
        "Bootstrap": "profile",
        "Profile": "profile",
        "bootstrap": "profile",
        "profile_likelihood": "profile",
        "FitResult": "result",
        "RecordingNoise": "result",
        "StartingValues": "start.driven",
        "starting_values": "start.driven",
    },
)
