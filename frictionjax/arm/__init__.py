"""Many joints: from logs of an arm and its rigid-body model to a diagnosis of the friction of each joint."""

from frictionjax.arm.diagnose_arm import diagnose_arm as diagnose_arm
from frictionjax.arm.diagnosis import ArmDiagnosis as ArmDiagnosis
from frictionjax.arm.diagnosis import JointDiagnosis as JointDiagnosis
from frictionjax.arm.fit_rigid_body import RigidBodyFit as RigidBodyFit
from frictionjax.arm.fit_rigid_body import fit_rigid_body as fit_rigid_body
from frictionjax.arm.log import ArmLog as ArmLog
from frictionjax.arm.read_log import read_arm_log as read_arm_log
