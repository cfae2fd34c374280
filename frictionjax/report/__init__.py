"""What a person reads: report.html, the summary printed in a terminal, pictures; and results saved and read back."""

from frictionjax.report.calibration_files import save_calibration as save_calibration
from frictionjax.report.load import load_diagnosis as load_diagnosis
from frictionjax.report.page import write_report as write_report
from frictionjax.report.plots import plot as plot
from frictionjax.report.save import check_writable as check_writable
from frictionjax.report.save import rescue_diagnosis as rescue_diagnosis
from frictionjax.report.save import reserved as reserved
from frictionjax.report.save import save_diagnosis as save_diagnosis
from frictionjax.report.save import verdict_json as verdict_json
from frictionjax.report.save_arm import arm_json as arm_json
from frictionjax.report.save_arm import check_arm_writable as check_arm_writable
from frictionjax.report.save_arm import save_arm_diagnosis as save_arm_diagnosis
from frictionjax.report.terminal import summary_lines as summary_lines
from frictionjax.report.terminal import truth_lines as truth_lines
