"""Results for other programs: fits as JSON files, drives as joints of MuJoCo, URDF, Isaac Lab and BAM."""

from frictionjax.exchange.bam import bam_parameters as bam_parameters
from frictionjax.exchange.fit_file import load_fit as load_fit
from frictionjax.exchange.fit_file import save_fit as save_fit
from frictionjax.exchange.isaac_lab import isaac_lab_actuator as isaac_lab_actuator
from frictionjax.exchange.joint import JointModel as JointModel
from frictionjax.exchange.mujoco import MujocoJoint as MujocoJoint
from frictionjax.exchange.mujoco import mujoco_joint as mujoco_joint
from frictionjax.exchange.read_joint import KnownJoint as KnownJoint
from frictionjax.exchange.read_joint import read_mujoco_joint as read_mujoco_joint
from frictionjax.exchange.urdf import urdf_dynamics as urdf_dynamics
