"""Starting values, the joint fit of all recordings, its uncertainty, what experiments can tell, results as files."""

from frictionjax.estimation.exchange import load_fit as load_fit
from frictionjax.estimation.exchange import save_fit as save_fit
from frictionjax.estimation.fit import FitResult as FitResult
from frictionjax.estimation.fit import fit as fit
from frictionjax.estimation.identifiability import Identifiability as Identifiability
from frictionjax.estimation.identifiability import NullDirection as NullDirection
from frictionjax.estimation.identifiability import identifiability as identifiability
from frictionjax.estimation.identifiability import information_of as information_of
from frictionjax.estimation.information import Information as Information
from frictionjax.estimation.information import fisher_information as fisher_information
from frictionjax.estimation.mujoco import MujocoJoint as MujocoJoint
from frictionjax.estimation.mujoco import mujoco_joint as mujoco_joint
from frictionjax.estimation.start import Start as Start
from frictionjax.estimation.start import starting_values as starting_values
