"""What a fit is given: a case in any form, and what its case knows of the machine, which no drive may contradict."""

import dataclasses
import sys

import numpy as np
import pytest
from helpers_plants import effect

import frictionjax as fj
from frictionjax.estimation.data.given import keeps_inertia, pieces_of, plant_of, require_agreement, units_of

RATE, N = 1000.0, 400
T = np.arange(N) / RATE
COLUMNS = {"t": T, "u": np.sin(7.0 * T), "x": 1e-3 * np.sin(7.0 * T - 0.3)}
PLANT = fj.Plant(motor_constant=16.0, position_unit="rad", force_unit="N*m", input_unit="V", inertia=0.1)
FRICTION = fj.LuGre(sigma0=1e5, sigma1=300.0, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3)


def _recording(name="run", role="fit", plant=None):
    return fj.recording_from_frame(COLUMNS, name=name, role=role, plant=plant)


def _case(plant=PLANT):
    return fj.Case("bench", plant, (_recording(), _recording("other", "holdout")))


def test_a_case_gives_its_recordings_to_fit_and_no_others():
    case = _case()
    assert pieces_of(case) == case.fit_recordings
    assert plant_of(pieces_of(case)) == PLANT


def test_what_is_given_by_a_path_is_fitted_whole(tmp_path):
    file = tmp_path / "run.csv"
    np.savetxt(file, np.column_stack(list(COLUMNS.values())), header="t,u,x", comments="", delimiter=",")
    for data in (file, str(file), [file], COLUMNS, [COLUMNS], _recording()):
        (piece,) = pieces_of(data)
        assert piece.x.size == N
        assert plant_of([piece]) is None
    toml = tmp_path / "case.toml"
    toml.write_text(
        '[plant]\nmotor_constant = 16.0\n[[recording]]\nfile = "run.csv"\ninterval = [0.0, 0.2]\n'
        '[[recording]]\nfile = "run.csv"\ninterval = [0.2, 0.4]\nrole = "holdout"\n',
        encoding="utf-8",
    )
    (piece,) = pieces_of(toml)
    assert (piece.x.size, piece.plant.motor_constant) == (200, 16.0)


@pytest.mark.untyped
@pytest.mark.parametrize("data", [3, [3], None, [None], np.zeros(3)])
def test_what_is_no_data_is_refused_with_what_would_be(data):
    with pytest.raises(fj.InputError, match=r"is no data for a fit\. Give a `Case`"):
        pieces_of(data)


@pytest.mark.parametrize("form", ["case", "recordings", "observation"])
def test_a_drive_that_contradicts_its_case_is_refused(form):
    case = _case()
    forms = {
        "case": case,
        "recordings": case.fit_recordings,
        "observation": [fj.Observation(case.fit_recordings[0])],
    }
    with pytest.raises(
        fj.InputError, match=r"motor_constant is 1, and the case .* 16, 16 times .*motor_constant=16.0"
    ):
        fj.fit(fj.Drive(0.1, FRICTION), forms[form])
    with pytest.raises(fj.InputError, match=r"J is 2, and the case of the data has inertia = 0.1, 20 times"):
        fj.fit(fj.Drive(2.0, FRICTION, 16.0), forms[form])


class _Reached(Exception):
    """The descent of a fit, which is not made here."""


@pytest.mark.parametrize(
    ("asked", "free"),
    [
        ({}, False),
        ({"free": ("J", "Fc")}, True),
        ({"priors": {"J": (0.1, 0.01)}}, True),
        ({"known_inertia": False}, True),
    ],
)
def test_a_fit_keeps_the_inertia_that_its_case_knows(asked, free, monkeypatch):
    reached = []

    def descent(posterior, *_):
        reached.append(posterior)
        raise _Reached

    monkeypatch.setattr(sys.modules["frictionjax.estimation.fit"], "_best", descent)
    with pytest.raises(_Reached):
        fj.fit(fj.Drive(0.1, FRICTION, 16.0), _case(), own_starts=False, **asked)
    labels = [one.label for one in reached[0].constraints.layout]
    assert ("J" in labels) is free
    assert "Fc" in labels


def test_many_fits_are_refused_alike():
    with pytest.raises(fj.InputError, match="motor_constant is 1, and the case"):
        fj.fit_many(fj.Drive(0.1, FRICTION), [_case().fit_recordings])


def test_what_is_asked_for_by_name_is_a_start_and_may_differ():
    drive = fj.Drive(2.0, FRICTION, 1.0)
    require_agreement(drive, PLANT, motor_constant=False, inertia=False)
    require_agreement(drive, None, motor_constant=True, inertia=True)
    require_agreement(drive, fj.Plant(), motor_constant=True, inertia=True)
    with pytest.raises(fj.InputError):
        require_agreement(drive, PLANT, motor_constant=True, inertia=False)


@pytest.mark.parametrize(
    ("unit", "turn", "agrees"),
    [
        *(("rad", 2 * np.pi, True), ("deg", 360.0, True), ("position", 360.0, True)),
        *(("deg", 2 * np.pi, False), ("rad", 360.0, False)),
    ],
)
def test_an_angle_in_another_unit_than_that_of_the_positions_is_refused(unit, turn, agrees):
    drive = fj.Drive(2.0, FRICTION, effects=(effect("GravityPendulum", sine=1.0, turn=turn),))
    known = {"motor_constant": False, "inertia": False}
    if agrees:
        require_agreement(drive, fj.Plant(position_unit=unit), **known)
        return
    with pytest.raises(fj.InputError, match=f"gravity_pendulum has a full turn of .* in {unit} is"):
        require_agreement(drive, fj.Plant(position_unit=unit), **known)


@pytest.mark.parametrize(
    ("plant", "asked", "free", "kept"),
    [
        (PLANT, None, (), True),
        (PLANT, None, ("J", "Fc"), False),
        (PLANT, False, (), False),
        (fj.Plant(), None, (), False),
        (None, None, (), False),
        (None, True, (), True),
    ],
)
def test_a_known_inertia_is_kept_unless_it_is_asked_for(plant, asked, free, kept):
    assert keeps_inertia(plant, asked, free) is kept


def test_recordings_of_two_machines_are_not_fitted_together():
    other = dataclasses.replace(PLANT, motor_constant=15.0)
    with pytest.raises(
        fj.InputError, match=r"machines with motor_constant = 16\.0 and motor_constant = 15.0"
    ):
        plant_of([_recording(plant=PLANT), _recording(plant=other)])
    coarser = dataclasses.replace(PLANT, encoder_step=1e-5)  # two encoders on one machine
    assert plant_of([_recording(plant=PLANT), _recording(plant=coarser)]) == PLANT


def test_units_are_those_of_the_case():
    assert units_of(PLANT) == {"force": "N*m", "position": "rad", "input": "V"}
    assert units_of(None) == {"force": "force", "position": "position", "input": "input"}
