"""Results for other programs: fits as JSON files, drives as MuJoCo models."""

from frictionjax.exchange.fit_file import load_fit as load_fit
from frictionjax.exchange.fit_file import save_fit as save_fit
from frictionjax.exchange.mujoco import MujocoJoint as MujocoJoint
from frictionjax.exchange.mujoco import mujoco_joint as mujoco_joint
