"""What was measured: recordings, cases, the readers of files and the audit of their content."""

from frictionjax.recordings.audit import Audit as Audit
from frictionjax.recordings.audit import audit as audit
from frictionjax.recordings.case import case_from_files as case_from_files
from frictionjax.recordings.case import load_case as load_case
from frictionjax.recordings.controller import Controller as Controller
from frictionjax.recordings.frame import recording_from_frame as recording_from_frame
from frictionjax.recordings.hold_out import hold_out_last_third as hold_out_last_third
from frictionjax.recordings.recording import Case as Case
from frictionjax.recordings.recording import Given as Given
from frictionjax.recordings.recording import GivenEffect as GivenEffect
from frictionjax.recordings.recording import GivenModel as GivenModel
from frictionjax.recordings.recording import Plant as Plant
from frictionjax.recordings.recording import Recording as Recording
from frictionjax.recordings.recording import Sampling as Sampling
