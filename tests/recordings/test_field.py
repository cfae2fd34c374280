"""Recordings as people bring them (where they are at hand): what is read, and what is said."""

import warnings
from pathlib import Path

import pytest

from frictionjax.core import InputError
from frictionjax.recordings import load_case

FIELD = Path(__file__).parents[3] / "shared" / "field"


def _load(name):
    """The case, and the warnings that came with it."""
    file = FIELD / name
    if not file.exists():
        pytest.skip("the field recordings are not here")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        return load_case(file), " ".join(str(one.message) for one in said)


READ = {
    "m1_mat_train_test_vars/case.toml": (100.0, [1200, 1200], ""),
    "m2_catchup_stamps/case.toml": (1000.0, [300, 190], "none is missing"),
    "m3_single_file_toml/case.toml": (500.0, [2000, 1000], "the last third"),
    "m4_duplicate_frames/case.toml": (100.0, [240, 140], "rows repeat the row before"),
    "i8_plc_scope/case.toml": (500.0, [4000, 1950], "decimal points"),
    "i8_plc_scope/v_meta.toml": (500.0, [1900, 1000], "decimal points"),
    "i8_plc_scope/v_pre.toml": (500.0, [1900, 1000], ""),
    "i8_plc_scope/v_simple.toml": (500.0, [1900, 1000], "decimal points"),
    "i8_plc_scope/v_stamp.toml": (500.0, [1900, 1000], ""),
    "i8_plc_scope/v_tab.toml": (500.0, [1900, 1000], "decimal points"),
    "i8_plc_scope/v_trail.toml": (500.0, [1900, 1000], ""),
    "i8_plc_scope/v_units.toml": (500.0, [1900, 1000], "decimal points"),
    "r3_bldc_sine/case.toml": (1000.0, [5999, 3000], "none is missing"),
}


@pytest.mark.parametrize("name", READ)
def test_what_is_read(name):
    rate, samples, words = READ[name]
    case, said = _load(name)
    assert [r.x.size for r in case.recordings] == samples
    for recording in case.recordings:
        assert recording.sample_rate == pytest.approx(rate, rel=1e-3)
    assert words in said
    assert bool(words) == bool(said)


REFUSED = {
    "i8_plc_scope/v_nan.toml": "line 502, column `u`: the value is missing",
    "i8_plc_scope/v_blankend.toml": "line 3002: 2 values where the file has 3 columns",
    "m6_int_column_numbers/case.toml": "94 samples, too few",
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_said_with_its_place(name):
    with pytest.raises(InputError, match=REFUSED[name]):
        _load(name)
