"""The information in experiments before they are made: Fisher information, Cramer-Rao bounds, identifiability in words,
and experiment design."""

from frictionjax.information.candidate_experiments import Rejected as Rejected
from frictionjax.information.discrimination import Discrimination as Discrimination
from frictionjax.information.discrimination import Discriminator as Discriminator
from frictionjax.information.discrimination import rank_for_discrimination as rank_for_discrimination
from frictionjax.information.fisher import Information as Information
from frictionjax.information.fisher import fisher_information as fisher_information
from frictionjax.information.identifiability import Identifiability as Identifiability
from frictionjax.information.identifiability import NullDirection as NullDirection
from frictionjax.information.identifiability import identifiability as identifiability
from frictionjax.information.identifiability import information_of as information_of
from frictionjax.information.multisine_design import DesignedMultisine as DesignedMultisine
from frictionjax.information.multisine_design import optimise_multisine as optimise_multisine
from frictionjax.information.ranking import RankedExperiment as RankedExperiment
from frictionjax.information.ranking import Ranking as Ranking
from frictionjax.information.ranking import rank_experiments as rank_experiments
