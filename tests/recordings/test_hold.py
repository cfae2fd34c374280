"""What the input does between samples: said in the case, for the program, and in Python."""

import warnings

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings import Plant, case_from_files, load_case

T = np.arange(600) / 1000.0


@pytest.fixture
def folder(tmp_path):
    """A case of two recordings, whose file has no plant yet."""
    for name, phase in (("run", 0.0), ("kept", 1.0)):
        rows = zip(T, np.cos(40.0 * T + phase), 0.01 * np.sin(31.0 * T + phase), strict=True)
        (tmp_path / f"{name}.csv").write_text(
            "t,u,x\n" + "\n".join(",".join(map(repr, map(float, row))) for row in rows)
        )
    return tmp_path


def _case(folder, plant):
    text = f'[plant]\n{plant}\n[[recording]]\nfile = "run.csv"\n[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'
    (folder / "case.toml").write_text(text)
    return load_case(folder / "case.toml")


@pytest.mark.parametrize("hold", ["zero", "linear", "auto"])
def test_the_case_says_it(folder, hold):
    case = _case(folder, f'hold = "{hold}"')
    assert case.plant.hold == hold
    assert all(one.plant.hold == hold for one in case.recordings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert case_from_files(folder / "run.csv", folder / "kept.csv", hold=hold).plant.hold == hold


def test_without_a_word_the_input_is_held(folder):
    assert _case(folder, "").plant.hold == "zero"
    assert "hold" not in repr(Plant()) and "hold='auto'" in repr(Plant(hold="auto"))


def test_another_word_is_refused(folder):
    with pytest.raises(InputError) as found:
        _case(folder, 'hold = "first"')
    said = str(found.value)
    assert '[plant], key `hold`: "first" is not a hold. Write "zero" or "linear" or "auto"' in said, said
