"""The public names."""

from frictionjax import excitation as excitation
from frictionjax.arm import ArmDiagnosis as ArmDiagnosis
from frictionjax.arm import ArmLog as ArmLog
from frictionjax.arm import JointDiagnosis as JointDiagnosis
from frictionjax.arm import RigidBodyFit as RigidBodyFit
from frictionjax.arm import diagnose_arm as diagnose_arm
from frictionjax.arm import fit_rigid_body as fit_rigid_body
from frictionjax.arm import read_arm_log as read_arm_log
from frictionjax.core import Estimate as Estimate
from frictionjax.core import FrictionjaxWarning as FrictionjaxWarning
from frictionjax.core import InputError as InputError
from frictionjax.core import PrecisionError as PrecisionError
from frictionjax.core import configure_jax as configure_jax
from frictionjax.diagnosis import Diagnosis as Diagnosis
from frictionjax.diagnosis import Effort as Effort
from frictionjax.diagnosis import Rule as Rule
from frictionjax.diagnosis import diagnose as diagnose
from frictionjax.diagnosis import warm as warm
from frictionjax.estimation import Bootstrap as Bootstrap
from frictionjax.estimation import Cauchy as Cauchy
from frictionjax.estimation import FitResult as FitResult
from frictionjax.estimation import Gaussian as Gaussian
from frictionjax.estimation import Huber as Huber
from frictionjax.estimation import Observation as Observation
from frictionjax.estimation import Profile as Profile
from frictionjax.estimation import Replicas as Replicas
from frictionjax.estimation import bootstrap as bootstrap
from frictionjax.estimation import fit as fit
from frictionjax.estimation import fit_many as fit_many
from frictionjax.estimation import profile_likelihood as profile_likelihood
from frictionjax.exchange import JointModel as JointModel
from frictionjax.exchange import KnownJoint as KnownJoint
from frictionjax.exchange import MujocoJoint as MujocoJoint
from frictionjax.exchange import bam_parameters as bam_parameters
from frictionjax.exchange import isaac_lab_actuator as isaac_lab_actuator
from frictionjax.exchange import load_fit as load_fit
from frictionjax.exchange import mujoco_joint as mujoco_joint
from frictionjax.exchange import read_mujoco_joint as read_mujoco_joint
from frictionjax.exchange import save_fit as save_fit
from frictionjax.exchange import urdf_dynamics as urdf_dynamics
from frictionjax.frequency import BLA as BLA
from frictionjax.frequency import FRF as FRF
from frictionjax.frequency import Resonances as Resonances
from frictionjax.frequency import ZeroAmplitude as ZeroAmplitude
from frictionjax.frequency import best_linear_approximation as best_linear_approximation
from frictionjax.frequency import estimate_frf as estimate_frf
from frictionjax.frequency import extrapolate_to_zero_amplitude as extrapolate_to_zero_amplitude
from frictionjax.frequency import fit_sk as fit_sk
from frictionjax.frequency import resonances as resonances
from frictionjax.information import DesignedMultisine as DesignedMultisine
from frictionjax.information import Discrimination as Discrimination
from frictionjax.information import Identifiability as Identifiability
from frictionjax.information import Information as Information
from frictionjax.information import Ranking as Ranking
from frictionjax.information import fisher_information as fisher_information
from frictionjax.information import identifiability as identifiability
from frictionjax.information import optimise_multisine as optimise_multisine
from frictionjax.information import rank_experiments as rank_experiments
from frictionjax.information import rank_for_discrimination as rank_for_discrimination
from frictionjax.physics import Drive as Drive
from frictionjax.physics import LuGre as LuGre
from frictionjax.physics import catalogue as catalogue
from frictionjax.physics import linearize as linearize
from frictionjax.recordings import Case as Case
from frictionjax.recordings import Controller as Controller
from frictionjax.recordings import Given as Given
from frictionjax.recordings import GivenEffect as GivenEffect
from frictionjax.recordings import GivenModel as GivenModel
from frictionjax.recordings import Plant as Plant
from frictionjax.recordings import Recording as Recording
from frictionjax.recordings import audit as audit
from frictionjax.recordings import case_from_files as case_from_files
from frictionjax.recordings import hold_out_last_third as hold_out_last_third
from frictionjax.recordings import load_case as load_case
from frictionjax.recordings import recording_from_frame as recording_from_frame
from frictionjax.report import load_diagnosis as load_diagnosis
from frictionjax.report import plot as plot
from frictionjax.report import save_arm_diagnosis as save_arm_diagnosis
from frictionjax.report import save_diagnosis as save_diagnosis
from frictionjax.simulation import Trajectory as Trajectory
from frictionjax.simulation import simulate as simulate
from frictionjax.simulation import simulate_batch as simulate_batch
from frictionjax.simulation import simulate_closed_loop as simulate_closed_loop
from frictionjax.simulation import simulate_imposed as simulate_imposed
from frictionjax.studies import Axis as Axis
from frictionjax.studies import Calibration as Calibration
from frictionjax.studies import CompiledTask as CompiledTask
from frictionjax.studies import DiagnosisTask as DiagnosisTask
from frictionjax.studies import DiscriminationTask as DiscriminationTask
from frictionjax.studies import Experiment as Experiment
from frictionjax.studies import Factorial as Factorial
from frictionjax.studies import FitTask as FitTask
from frictionjax.studies import PythonTask as PythonTask
from frictionjax.studies import RandomDesign as RandomDesign
from frictionjax.studies import ResponseTask as ResponseTask
from frictionjax.studies import SimulationTask as SimulationTask
from frictionjax.studies import SobolDesign as SobolDesign
from frictionjax.studies import Study as Study
from frictionjax.studies import calibration_of as calibration_of
from frictionjax.studies import calibration_study as calibration_study
from frictionjax.studies import check_diagnosis as check_diagnosis
from frictionjax.studies import compare_estimators as compare_estimators
from frictionjax.studies import level_sweep as level_sweep
from frictionjax.studies import load_study as load_study
from frictionjax.studies import run_study as run_study
from frictionjax.studies import summarise as summarise

__all__ = [
    "BLA",
    "FRF",
    "ArmDiagnosis",
    "ArmLog",
    "Axis",
    "Bootstrap",
    "Calibration",
    "Case",
    "Cauchy",
    "CompiledTask",
    "Controller",
    "DesignedMultisine",
    "Diagnosis",
    "DiagnosisTask",
    "Discrimination",
    "DiscriminationTask",
    "Drive",
    "Effort",
    "Estimate",
    "Experiment",
    "Factorial",
    "FitResult",
    "FitTask",
    "FrictionjaxWarning",
    "Gaussian",
    "Given",
    "GivenEffect",
    "GivenModel",
    "Huber",
    "Identifiability",
    "Information",
    "InputError",
    "JointDiagnosis",
    "JointModel",
    "KnownJoint",
    "LuGre",
    "MujocoJoint",
    "Observation",
    "Plant",
    "PrecisionError",
    "Profile",
    "PythonTask",
    "RandomDesign",
    "Ranking",
    "Recording",
    "Replicas",
    "Resonances",
    "ResponseTask",
    "RigidBodyFit",
    "Rule",
    "SimulationTask",
    "SobolDesign",
    "Study",
    "Trajectory",
    "ZeroAmplitude",
    "audit",
    "bam_parameters",
    "best_linear_approximation",
    "bootstrap",
    "calibration_of",
    "calibration_study",
    "case_from_files",
    "catalogue",
    "check_diagnosis",
    "compare_estimators",
    "configure_jax",
    "diagnose",
    "diagnose_arm",
    "estimate_frf",
    "excitation",
    "extrapolate_to_zero_amplitude",
    "fisher_information",
    "fit",
    "fit_many",
    "fit_rigid_body",
    "fit_sk",
    "hold_out_last_third",
    "identifiability",
    "isaac_lab_actuator",
    "level_sweep",
    "linearize",
    "load_case",
    "load_diagnosis",
    "load_fit",
    "load_study",
    "mujoco_joint",
    "optimise_multisine",
    "plot",
    "profile_likelihood",
    "rank_experiments",
    "rank_for_discrimination",
    "read_arm_log",
    "read_mujoco_joint",
    "recording_from_frame",
    "resonances",
    "run_study",
    "save_arm_diagnosis",
    "save_diagnosis",
    "save_fit",
    "simulate",
    "simulate_batch",
    "simulate_closed_loop",
    "simulate_imposed",
    "summarise",
    "urdf_dynamics",
    "warm",
]
