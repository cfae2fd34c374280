"""`benchmarks.nist`: the layout of NIST's files, correct digits, and the least squares of a fit without recordings."""

import sys

import jax
import numpy as np
import pytest

from benchmarks.nist import __main__ as program
from benchmarks.nist import descents
from benchmarks.nist.__main__ import SOLVERS, digits, row, summary
from benchmarks.nist.descents import Ended, residuals_of
from benchmarks.nist.models import MODELS
from benchmarks.nist.problems import all_problems, read_problem
from frictionjax.core import InputError
from frictionjax.estimation.descent import refine, round
from frictionjax.studies.real_machines import VARIABLE

LINES = """NIST/ITL StRD
Dataset Name:  {name}          ({name}.dat)

File Format:   ASCII
               Starting Values   (lines 12 to 13)
               Certified Values  (lines 12 to 18)
               Data              (lines 21 to {last})

               Average Level of Difficulty

        Start 1     Start 2           Parameter     Standard Deviation
  b1 =   500         250           {b1}  2.5E+00
  b2 =     0.0001      .0005       {b2}  7.0E-06

Residual Sum of Squares:                    {squares}
Residual Standard Deviation:                1.0E-01
Degrees of Freedom:                                {free}
Number of Observations:                            {count}

Data:   y               x
{data}"""
TRUTH = np.array([240.0, 5.5e-4])
NOISE = 0.1
X = np.linspace(80.0, 760.0, 14)


def _write(folder, y, squares, name="Misra1a", x=X):
    """A file in the layout of NIST, whose certified values are the truth; the data begin on line 21."""
    data = "\n".join(f"      {a:.15E}    {b:.15E}" for a, b in zip(y, x, strict=True))
    path = folder / f"{name}.dat"
    b1, b2 = (f"{value:.10E}" for value in TRUTH)
    known = {"last": 20 + x.size, "count": x.size, "free": x.size - 2, "squares": f"{squares:.10E}"}
    path.write_text(LINES.format(name=name, b1=b1, b2=b2, data=data, **known))
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A problem whose minimum is at the truth: its residuals there are orthogonal to every derivative."""
    model = MODELS["Misra1a"]
    slope = np.asarray(jax.jacfwd(model)(TRUTH, X[None]))
    basis, _ = np.linalg.qr(slope)
    noise = NOISE * np.random.default_rng(0).standard_normal(X.size)
    noise -= basis @ (basis.T @ noise)
    return _write(tmp_path_factory.mktemp("nist"), np.asarray(model(TRUTH, X[None])) + noise, noise @ noise)


def test_a_file_is_read(made):
    problem = read_problem(made)
    assert (problem.name, problem.level) == ("Misra1a", "Average")
    np.testing.assert_allclose(problem.x[0], X, rtol=1e-14)
    assert problem.y.shape == X.shape
    assert problem.starts.tolist() == [[500.0, 1e-4], [250.0, 5e-4]]
    assert problem.certified.tolist() == TRUTH.tolist()
    assert problem.deviations.tolist() == [2.5, 7e-6]
    e = np.asarray(residuals_of(problem).errors(problem.certified))
    assert e @ e == pytest.approx(problem.squares, rel=1e-8)


def test_the_model_of_nelson_is_that_of_the_logarithm(tmp_path):
    assert read_problem(_write(tmp_path, np.full(14, 10.0), 1.0, "Nelson")).y[0] == np.log(10.0)


@pytest.mark.parametrize(
    ("changed", "into", "where"),
    [
        ("Residual Sum of Squares:", "", "no problem of nonlinear regression"),
        ("b2 =", "b3 =", "in turn"),
        ("(lines 21 to 34)", "(lines 21 to 35)", "line 35"),
        ("(lines 21 to 34)", "(lines 20 to 34)", "line 20"),
    ],
)
def test_a_file_of_another_layout_is_refused(changed, into, where, made, tmp_path):
    path = tmp_path / "Misra1a.dat"
    path.write_text(made.read_text().replace(changed, into))
    with pytest.raises(InputError, match=where) as raised:
        read_problem(path)
    assert "pip download lmfit" in str(raised.value)


def test_what_is_absent_is_said_with_where_to_get_it(made, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, str(made.parent))
    assert [one.name for one in all_problems(names=["Misra1a"])] == ["Misra1a"]
    monkeypatch.setattr(sys, "argv", ["nist", "--data", str(tmp_path)])
    assert program.main() == 1
    said = capsys.readouterr().err
    for word in ("Bennett5.dat", "pip download lmfit", "--data", VARIABLE):
        assert word in said


def test_digits_are_those_of_the_worst_parameter():
    certified = np.array([100.0, -1e-8])
    assert digits(certified, certified) == 11.0
    assert digits(np.array([100.0, -1.001e-8]), certified) == pytest.approx(3.0)
    assert digits(np.array([-100.0, -1e-8]), certified) == 0.0
    assert digits(np.array([np.nan, -1e-8]), certified) == 0.0


def test_steps_and_rounds_are_those_of_a_fit():
    assert descents._FAR_STEPS == refine._MANY_STEPS
    assert descents._ROUND_STEPS == round._STEPS
    assert descents._SHORTER == refine._SHORTER


def test_every_solver_finds_the_minimum_from_both_starts(made, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["nist", "Misra1a", "--data", str(made.parent)])
    assert program.main() == 0
    table, counts = capsys.readouterr().out.split("\n\n")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert len({len(cells) for cells in rows}) == 1
    assert [cells[2] for cells in rows[2:]] == ["1", "2"]
    for cells in rows[2:]:
        off, fit, alone, *scipy = (float(cells[place]) for place in (4, 3, 6, 8, 10))
        assert off < 0.05  # of a standard deviation, where a fit stops
        assert fit > 3.0
        assert min(alone, *scipy) > 7.0
        assert all(3 <= int(cells[place]) < 200 for place in (5, 7, 9, 11))
    assert [line.split(":")[0] for line in counts.splitlines()] == list(SOLVERS)
    assert "solver alone: 2 of 2" in counts


def test_a_start_without_derivatives_ends_where_it_is(made):
    """Far out the model is constant in b2: the slope does not say where to go."""
    problem = read_problem(made)
    for solver in (descents.as_fit, descents.alone):
        ended = solver(problem, np.array([250.0, 10.0]))
        assert ended.parameters[1] == 10.0
        assert digits(ended.parameters, problem.certified) == 0.0


def test_a_solver_that_solves_nothing_has_no_median(made):
    ended = {"scipy lm": Ended(np.array([1.0, 1.0]), 9, "")}
    assert row(read_problem(made), 1, ended) == "| Misra1a | average | 2 | 0.0 | 9 |"
    assert summary({"scipy lm": [0.0]}, {"scipy lm": [7.0]}, {"scipy lm": [9]}).startswith(
        "scipy lm: 0 of 1 to 4 digits or more, these to -"
    )


def test_every_model_has_its_certified_minimum():
    """The files of NIST, where they are: the sum of squares at the certified values is the certified one."""
    try:
        problems = all_problems()
    except InputError as absent:
        pytest.skip(str(absent))
    assert [one.name for one in problems] == list(MODELS)
    for problem in problems:
        e = np.asarray(residuals_of(problem).errors(problem.certified))
        if problem.name == "Lanczos1":  # its residuals are smaller than what eleven digits leave
            assert e @ e < 1e-20
        else:
            assert e @ e == pytest.approx(problem.squares, rel=1e-9), problem.name
