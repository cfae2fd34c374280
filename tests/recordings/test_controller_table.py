"""The controller in a case file: what is read, and what is refused with its place."""

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings import Controller, case_from_files, load_case
from frictionjax.recordings.controller_table import parse_controller

RECORDING = '[[recording]]\nfile = "run.csv"\nloop = "{}"\n'


@pytest.fixture
def folder(tmp_path):
    rows = np.column_stack([np.arange(400) / 100.0, np.sin(np.arange(400)), 0.1 * np.cos(np.arange(400))])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,u,x", comments="")
    return tmp_path


def _read(folder, controller, loop="closed"):
    (folder / "case.toml").write_text(f"[controller]\n{controller}\n{RECORDING.format(loop)}")
    return load_case(folder / "case.toml").controller


@pytest.mark.filterwarnings("ignore:.*last third")
def test_a_controller_stands_in_the_case(folder):
    found = _read(folder, "kp = 16\nkd = 0.3\nlimit = 10.0\nrate = 1000.0")
    assert (found.kp, found.ki, found.kd, found.limit, found.rate) == (16.0, 0.0, 0.3, 10.0, 1000.0)
    assert _read(folder, "ki = 2.0").limit == np.inf
    given = case_from_files(folder / "run.csv", loop="closed", controller={"kp": 16, "rate": 50})
    assert given.controller == Controller(kp=16.0, rate=50.0)
    assert case_from_files(folder / "run.csv", loop="closed").controller is None
    assert parse_controller(None, (), "case.toml") is None


@pytest.mark.filterwarnings("ignore:.*last third")
@pytest.mark.parametrize(
    ("controller", "loop", "words"),
    [
        ("kp = 16.0", "open", "[controller]: no recording was made in closed loop"),
        (
            "limit = 3.0",
            "closed",
            "[controller]: the controller has no gain. Give at least one of kp, ki, kd",
        ),
        ("kp = 0.0", "closed", "[controller]: the controller has no gain"),
        ("kp = 1.0\nlimits = 3.0", "closed", "key `limits`: unknown key `limits`. Did you mean `limit`?"),
        ("kp = 1.0\nlimit = 0.0", "closed", "key `limit`: 0 is not above zero"),
        ("kp = 1.0\nrate = -5.0", "closed", "key `rate`: -5 is not above zero"),
        ('kp = "high"', "closed", "key `kp`: a number is needed, not text"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(folder, controller, loop, words):
    with pytest.raises(InputError) as caught:
        _read(folder, controller, loop)
    assert words in str(caught.value) and "case.toml" in str(caught.value)


def test_a_controller_is_a_table(folder):
    (folder / "case.toml").write_text(f"controller = 3\n{RECORDING.format('closed')}")
    with pytest.raises(InputError, match="the controller is not a table"):
        load_case(folder / "case.toml")
