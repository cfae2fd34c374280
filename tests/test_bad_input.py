"""Every mistake of a user ends in one line that names the file, the place and the cure."""

import warnings

import pytest
from helpers_recordings import FIT, HEADER, HOLDOUT, bare, case, check_message, plant, recording, toml, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import load_case

# Name: how to make it, and words that the message must hold.
BAD = {
    # the case file
    "case file missing": (
        lambda folder: toml(folder) and (lambda: load_case(folder / "cas.toml")),
        ["cas.toml", "does not exist", 'Did you mean "case.toml"?'],
    ),
    "case file in no folder": (
        lambda f: lambda: load_case(f / "no" / "case.toml"),
        ["There is no folder", "no"],
    ),
    "case file is a folder": (
        lambda f: toml(f) and (lambda: load_case(f)),
        ["is a folder", "Name case.toml"],
    ),
    "not TOML": (case("name = \n"), ["case.toml, line 1", "not valid TOML", "key = value"]),
    "TOML cut short": (case('name = "bad'), ["case.toml", "not valid TOML"]),
    "unquoted text": (case("name = arm\n" + FIT + HOLDOUT), ["case.toml, line 1", "quotes"]),
    "deep nesting": (case("name = " + "[" * 5000), ["case.toml", "TOML"]),
    "unknown key of the case": (
        case('nmae = "bad"\n' + FIT + HOLDOUT),
        ["key `nmae`", "unknown key", "Did you mean `name`?", "Allowed here: name, plant, recording"],
    ),
    "name of a wrong type": (
        case("name = 3\n" + FIT + HOLDOUT),
        ["key `name`", "text is needed, not a number"],
    ),
    "plant is no table": (case("plant = 3\n" + FIT + HOLDOUT), ["key `plant`", "Write [plant]"]),
    "single brackets": (case(HEADER + FIT.replace("[[", "[").replace("]]", "]")), ["[[recording]]"]),
    "no recording": (case(HEADER), ["no recording to fit", 'role = "fit"']),
    "no fit recording": (case(HEADER + HOLDOUT), ["case.toml", "no recording to fit"]),
    "no holdout recording": (
        case(HEADER + FIT + HOLDOUT.replace('role = "holdout"', "")),
        ["case.toml", "held out", "not fitted to", 'at least one recording with role = "holdout"'],
    ),
    # the plant
    "unknown key of the plant": (
        plant("motor_constnat = 2.0"),
        ["[plant]", "motor_constnat", "Did you mean `motor_constant`?", "encoder_step"],
    ),
    "motor constant zero": (plant("motor_constant = 0"), ["[plant], key `motor_constant`", "Leave it out"]),
    "motor constant negative": (plant("motor_constant = -2"), ["key `motor_constant`", "scale = {u = -1.0}"]),
    "motor constant nan": (
        plant("motor_constant = nan"),
        ["key `motor_constant`", "nan is not a finite number"],
    ),
    "motor constant huge": (plant("motor_constant = 1" + "0" * 400), ["key `motor_constant`", "finite"]),
    "motor constant in quotes": (
        plant('motor_constant = "2"'),
        ["key `motor_constant`", "not text", "quotes"],
    ),
    "motor constant true": (plant("motor_constant = true"), ["key `motor_constant`", "not true or false"]),
    "encoder step zero": (plant("encoder_step = 0.0"), ["key `encoder_step`", "Leave it out"]),
    "inertia negative": (plant("inertia = -1.0"), ["key `inertia`", "not above zero"]),
    "unit of a wrong type": (plant("force_unit = 1"), ["key `force_unit`", "text is needed"]),
    # the keys of a recording
    "unknown key of a recording": (
        recording("samplerate = 1000.0"),
        ['recording 1 ("run.csv")', "`samplerate`", "Did you mean `sample_rate`?", "interval"],
    ),
    "no file": (
        case(HEADER + '[[recording]]\nrole = "fit"\n' + HOLDOUT),
        ["recording 1, key `file`", "no file"],
    ),
    "file of a wrong type": (
        case(HEADER + "[[recording]]\nfile = 3\n"),
        ["recording 1, key `file`", "quotes"],
    ),
    "file empty": (case(HEADER + '[[recording]]\nfile = ""\n'), ["key `file`", "empty"]),
    "wrong role": (recording('role = "test"'), ["key `role`", '"test"', '"fit" or "holdout"']),
    "wrong loop": (recording('loop = "half"'), ["key `loop`", '"open" or "closed"']),
    "wrong drive": (recording('drive = "velocity"'), ["key `drive`", '"force" or "motion"']),
    "start time a date": (recording("start_time = 2024-03-01"), ["key `start_time`", "not a date or time"]),
    "sample rate zero": (recording("sample_rate = 0"), ["key `sample_rate`", "not above zero"]),
    "sample rate contradicts time": (
        recording("sample_rate = 2000.0"),
        ["run.csv", "1000 Hz", "2000 Hz", "Remove sample_rate", 'units = {t = "ms"}', "--unit t=ms"],
    ),
    "sample rate out of this world": (
        recording("scale = {t = 1e-30}"),
        ["run.csv", "sample rate is 1e+33 Hz", "ms"],
    ),
    "scale too small": (recording("scale = {x = 1e-90}"), ["key `scale.x`", "too small"]),
    "columns are no table": (recording('columns = "x"'), ["key `columns`", "columns = {x ="]),
    "unknown role of a column": (
        recording('columns = {pos = "x"}'),
        ["key `columns.pos`", "unknown key", "normal_force"],
    ),
    "column of a wrong type": (recording("columns = {x = 3.5}"), ["key `columns.x`", "text is needed"]),
    "column not in the file": (
        recording('columns = {x = "X"}'),
        [
            "run.csv",
            "columns.x",
            "no column `X`",
            "Did you mean `x`?",
            'columns = {t = "t", u = "u", x = "x"}',
        ],
    ),
    "one column for two roles": (
        recording('columns = {u = "x"}'),
        ["columns.u", "`x` is to be both u and x", "t, u, x"],
    ),
    "u for an imposed motion": (
        recording('drive = "motion"\ncolumns = {u = "u", force = "u"}'),
        ["columns.u", "there is no input"],
    ),
    "imposed motion without force": (
        recording('drive = "motion"'),
        ["run.csv", "force", 'columns = {t = "t", x = "x", force = "u"}'],
    ),
    "scale of an unknown column": (recording("scale = {y = 2.0}"), ["key `scale.y`", "unknown key"]),
    "scale of an absent column": (recording("scale = {v = 2.0}"), ["key `scale.v`", "no column", "t, u, x"]),
    "scale zero": (recording("scale = {x = 0.0}"), ["key `scale.x`", "zero"]),
    "scale in quotes": (recording('scale = {x = "mm"}'), ["key `scale.x`", "a number is needed"]),
    "interval reversed": (recording("interval = [0.2, 0.1]"), ["key `interval`", "ends before it begins"]),
    "interval outside": (
        recording("interval = [0.0, 9.0]"),
        ["run.csv", "key `interval`", "outside", "0.199 s"],
    ),
    "interval before the file": (recording("interval = [-9.0, -8.0]"), ["key `interval`", "outside"]),
    "interval of one time": (recording("interval = [0.1]"), ["key `interval`", "two times"]),
    "interval of text": (recording('interval = ["a", "b"]'), ["key `interval`", "two times"]),
    "interval too short": (recording("interval = [0.0, 0.05]"), ["run.csv", "50 samples", "at least 100"]),
    "holdout shares samples": (
        case(HEADER + FIT + FIT + 'role = "holdout"\n'),
        ["recording 2", "shares samples", "do not overlap"],
    ),
    "intervals overlap": (
        case(HEADER + FIT + "interval = [0.0, 0.12]\n" + FIT + 'interval = [0.1, 0.2]\nrole = "holdout"\n'),
        ["recording 2", "key `interval`", "shares samples"],
    ),
    "holdout is a copy": (
        lambda folder: (
            (toml(folder) and write(folder, "kept.csv")) or (lambda: load_case(folder / "case.toml"))
        ),
        ["recording 2", '"kept"', "same positions", '"run"'],
    ),
    # bare files
    "bare: no files": (bare([], ["kept.csv"]), ["no recording to fit"]),
    "bare: several files, no holdout": (
        bare(["run.csv", "kept.csv"], []),
        ["held out", "at least one file as holdout"],
    ),
    "bare: one short file": (
        bare(["run.csv"], []),
        ["run", "200 samples", "too few to hold out a third", "300"],
    ),
    "bare: motor constant zero": (bare(["run.csv"], ["kept.csv"], motor_constant=0.0), ["motor_constant"]),
    "bare: file missing": (bare(["rum.csv"], ["kept.csv"]), ["rum.csv", 'Did you mean "run.csv"?']),
    "bare: holdout is a fit file": (bare(["run.csv"], ["run.csv"]), ["shares samples"]),
    "bare: wrong loop": (bare(["run.csv"], ["kept.csv"], loop="shut"), ["key `loop`", '"open" or "closed"']),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_reported_in_one_line(tmp_path, name):
    make, words = BAD[name]
    check_message(make(tmp_path), words)


def test_the_good_case_behind_the_bad_ones(tmp_path):
    case = toml(tmp_path)()
    assert [r.name for r in case.recordings] == ["run", "kept"]


def test_a_gap_is_filled_with_a_warning_that_names_the_file(tmp_path):
    with pytest.warns(FrictionjaxWarning, match=r"run\.csv: .* 1 gap"):
        toml(tmp_path, change=lambda rows: rows[:50] + rows[55:])()


KEYS = [
    "name",
    "plant",
    "recording",
    "file",
    "role",
    "loop",
    "drive",
    "start_time",
    "sample_rate",
    "columns",
    "scale",
]
KEYS += ["interval", "motor_constant", "inertia", "encoder_step", "force_unit", "x", "t", "plant.inertia", ""]
VALUES = [
    "1",
    "-1.0",
    "0",
    "nan",
    "inf",
    "1e400",
    "true",
    "2024-03-01",
    "[]",
    "[[]]",
    "[0,1]",
    "[1e9,2e9]",
    "[0.0,0.15]",
]
VALUES += [
    '""',
    '"fit"',
    '"run.csv"',
    '"kept.csv"',
    '"."',
    '"x"',
    '"\\u0000"',
    '"\\u2028\\n"',
    "''",
    "{}",
    "{{",
    "{x=[]}",
]
VALUES += ['{x="x"}', '{t="x"}', '{x="\\u0085"}', "{x=1e-3}", "{x=1e300}", "{x=nan}", "{t=1e-300}", "{u=-1}"]
LINES = st.one_of(
    st.builds("{} = {}".format, st.sampled_from(KEYS), st.sampled_from(VALUES)),
    st.sampled_from(
        ["[plant]", "[[recording]]", *FIT.splitlines(), *HOLDOUT.splitlines(), "[recording]", "[[plant]]"]
    ),
    st.text(max_size=20),
)


@settings(
    max_examples=200,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.lists(LINES, max_size=8), st.booleans())
def test_a_garbled_case_file_is_an_input_error_or_a_case(tmp_path, garbled, after):
    good = [FIT + HOLDOUT]
    load = toml(tmp_path)
    (tmp_path / "case.toml").write_text(
        "\n".join(good + garbled if after else garbled + good), encoding="utf-8"
    )
    try:
        with warnings.catch_warnings(action="ignore", category=FrictionjaxWarning):
            load()
    except InputError as error:
        assert len(str(error).splitlines()) == 1
