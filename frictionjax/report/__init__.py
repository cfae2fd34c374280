"""What a person reads: report.html, the summary printed in a terminal, pictures; and results saved and read back."""

from typing import TYPE_CHECKING

from frictionjax.core.late_door import late_door

if TYPE_CHECKING:
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

late_door(
    __name__,
    {
        "save_calibration": "calibration_files",
        "load_diagnosis": "load",
        "write_report": "page",
        "plot": "plots",
        "check_writable": "save",
        "rescue_diagnosis": "save",
        "reserved": "save",
        "save_diagnosis": "save",
        "verdict_json": "save",
        "arm_json": "save_arm",
        "check_arm_writable": "save_arm",
        "save_arm_diagnosis": "save_arm",
        "summary_lines": "terminal",
        "truth_lines": "terminal",
    },
)
