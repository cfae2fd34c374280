"""What was measured: recordings, cases, the readers of files and the audit of what they hold."""

from frictionjax.recordings.recording import Case as Case
from frictionjax.recordings.recording import Plant as Plant
from frictionjax.recordings.recording import Recording as Recording
