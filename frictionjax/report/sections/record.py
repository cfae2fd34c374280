"""Warnings, the data used, and the computing time of each stage."""

from typing import ClassVar

import numpy as np

from frictionjax.diagnosis.verdict import Diagnosis, RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report.format import DASH, number, quantity, unit_text, words
from frictionjax.report.html import table, text
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import holdout_first


class Record(AbstractSection):
    """The warnings; a table of the recordings; a table of the stages."""

    title: ClassVar[str] = "Data, warnings, timings"

    def body(self, diagnosis: Diagnosis) -> str:
        return _warnings(diagnosis) + _data(diagnosis) + _timings(diagnosis)


def _warnings(diagnosis: Diagnosis) -> str:
    if not diagnosis.warnings:
        return "<h3>Warnings</h3><p>None from the audit of the data or from the fit.</p>"
    return (
        "<h3>Warnings</h3><ul>" + "".join(f"<li>{text(line)}</li>" for line in diagnosis.warnings) + "</ul>"
    )


def _data(diagnosis: Diagnosis) -> str:
    plant = diagnosis.plant
    constant = (
        "unknown: forces are in input units"
        if plant.motor_constant is None
        else f"{number(plant.motor_constant)} {unit_text(plant.force_unit)}/{unit_text(plant.input_unit)}"
    )
    facts = [f"motor constant {constant}"]
    if plant.encoder_step is not None:
        facts.append(f"encoder step {quantity(plant.encoder_step, plant.position_unit)}")
    facts.append("inertia identified" if plant.inertia is None else f"inertia known, {number(plant.inertia)}")
    head = ("recording", "role", "drive", "samples", "rate", "length", "input rms", "input peak", "stroke")
    rows = [_recording(recording, plant) for recording in holdout_first(diagnosis.recordings)]
    body = table(head, rows) if rows else ""
    return f"<h3>Data</h3><p>Plant: {text('; '.join(facts))}.</p>{body}"


def _recording(recording: RecordingFit, plant: Plant) -> tuple[str, ...]:
    t, u, x = recording.t, recording.u, recording.x
    step = (t[-1] - t[0]) / (t.size - 1) if t.size > 1 else float("nan")
    return (
        text(recording.name),
        "held out" if recording.role == "holdout" else "fit",
        recording.drive,
        str(t.size),
        f"{1 / step:.6g} Hz" if step > 0 else DASH,
        f"{number(step * t.size)} s",
        text(quantity(float(np.sqrt(np.mean(np.square(u)))), plant.input_unit)),
        text(quantity(float(np.max(np.abs(u))), plant.input_unit)),
        text(quantity(float(np.ptp(x)), plant.position_unit)),
    )


def _timings(diagnosis: Diagnosis) -> str:
    if not diagnosis.seconds:
        return ""
    stages = sorted(diagnosis.seconds.items(), key=lambda stage: stage[0] == "total")
    return "<h3>Timings</h3>" + table(
        ("stage", "seconds"), [(text(words(stage)), number(seconds)) for stage, seconds in stages]
    )
