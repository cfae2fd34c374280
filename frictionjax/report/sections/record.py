"""Warnings, the data used, and the computing time of each stage."""

from typing import ClassVar

import numpy as np
from markupsafe import Markup

from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.recordings import Plant
from frictionjax.report.format import DASH, number, quantity, unit_text, words
from frictionjax.report.html import table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import holdout_first
from frictionjax.report.template import fill

_COMPILE = "compile"  # the stage that is a part of the others


class RecordSection(AbstractSection):
    """The warnings; a table of the recordings; a table of the stages."""

    title: ClassVar[str] = "Data, warnings, timings"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = holdout_first(diagnosis.recordings)
        head = (
            "recording", "role", "drive", "samples", "rate", "length", "input rms", "input peak", "stroke",
        )  # fmt: skip
        rows = [_recording(recording, diagnosis.plant) for recording in recordings]
        stages = [stage for stage in diagnosis.seconds if stage not in (_COMPILE, "total")]
        times = [(words(stage), number(diagnosis.seconds[stage])) for stage in stages]
        if "total" in diagnosis.seconds:
            times.append(("total", number(diagnosis.seconds["total"])))
        compiling = ""
        if _COMPILE in diagnosis.seconds:
            compiling = f"Of these, JAX compiled programs for {number(diagnosis.seconds[_COMPILE])} s, which it keeps."
        return fill(
            "record.html.j2",
            warnings=diagnosis.warnings,
            plant=_plant(diagnosis.plant),
            data=table(head, rows) if rows else "",
            timings=table(("stage", "seconds"), times) if times else "",
            compiling=compiling,
        )


def _plant(plant: Plant) -> str:
    constant = (
        "unknown: forces are in input units"
        if plant.motor_constant is None
        else f"{number(plant.motor_constant)} {unit_text(plant.force_unit)}/{unit_text(plant.input_unit)}"
    )
    facts = [f"motor constant {constant}"]
    if plant.encoder_step is not None:
        facts.append(f"encoder step {quantity(plant.encoder_step, plant.shown_position)}")
    facts.append("inertia identified" if plant.inertia is None else f"inertia known, {number(plant.inertia)}")
    return "; ".join(facts)


def _recording(recording: RecordingFit, plant: Plant) -> tuple[str, ...]:
    t, u, x = recording.t, recording.u, recording.x
    step = (t[-1] - t[0]) / (t.size - 1) if t.size > 1 else float("nan")
    return (
        recording.name,
        "held out" if recording.role == "holdout" else "fit",
        recording.drive,
        str(t.size),
        f"{1 / step:.6g} Hz" if step > 0 else DASH,
        f"{number(step * t.size)} s",
        quantity(float(np.sqrt(np.mean(np.square(u)))), plant.shown_input),
        quantity(float(np.max(np.abs(u))), plant.shown_input),
        quantity(float(np.ptp(x)), plant.shown_position),
    )
