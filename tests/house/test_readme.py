"""The README: short, complete, and true of the package that it comes with."""

import ast
import dataclasses
import re
import runpy
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import frictionjax as fj

REPOSITORY = next(folder for folder in Path(__file__).parents if (folder / "pyproject.toml").is_file())
README = REPOSITORY / "README.md"
MOST = 4200  # bytes

pytestmark = pytest.mark.skipif(
    not (REPOSITORY / "benchmarks").is_dir(), reason="a source archive has only a part of what is linked"
)


@pytest.fixture(scope="module")
def text():
    return README.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def code(text):
    (block,) = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    return block


def test_it_is_short():
    assert README.stat().st_size <= MOST


def test_its_parts_stand_in_their_order(text):
    parts = (
        "![",
        "frictionjax demo",
        "python -m pytest",
        "frictionjax diagnose",
        "```python",
        "sealed",
        "| family |",
    )
    places = [text.index(part) for part in parts]
    assert places == sorted(places)


def test_the_first_code_block_runs_the_demo(text):
    first = re.findall(r"^```\w*\n(.*?)^```", text, re.M | re.S)[0]
    assert first.strip() == "python -m pip install . && frictionjax demo --out out/demo"


def test_it_names_every_effect_in_its_family(text):
    families = runpy.run_path(str(REPOSITORY / "docs" / "make_effects.py"))["families"]()
    assert {name for names in families.values() for name in names} == set(fj.catalogue())
    for family, names in families.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| {family} |"))
        assert re.findall(r"`(\w+)`", row) == names


def test_its_links_lead_somewhere(text):
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", text)
    assert len(links) > 10
    missing = [link for link in links if "://" not in link and not (REPOSITORY / link).exists()]
    assert not missing


def test_its_python_uses_public_names(code):
    attributes = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)]
    used = {text for text in map(ast.unparse, attributes) if re.fullmatch(r"[\w.]+", text)}
    assert {"fj.diagnose", "fj.fit", "fj.load_case", "found.summary"} <= used
    nouns = {"found": fj.Diagnosis, "result": fj.FitResult, "case": fj.Case}
    for name in used:
        variable, _, attribute = name.partition(".")
        if variable == "fj":
            attrgetter(attribute)(fj)  # an AttributeError names what is missing
        elif variable in nouns:
            noun = nouns[variable]
            assert attribute in {field.name for field in dataclasses.fields(noun)} | set(dir(noun)), name


@pytest.mark.slow
def test_its_fit_runs_on_a_small_case(code, capsys):
    """From the friction law on, because a diagnosis takes a minute; the case is one short recording."""
    rate, n = 2000.0, 2000
    t = np.arange(n) / rate
    u = 0.15 * np.sin(2.0 * np.pi * 1.5 * t) + 0.02 * np.sin(2.0 * np.pi * 40.0 * t)
    friction = fj.LuGre(sigma0=1.1e5, sigma1=300.0, sigma2=0.5, Fc=1.1, Fs=1.4, vs=1.2e-3)
    x = fj.simulate(fj.Drive(J=0.9, friction=friction, motor_constant=16.0), u, rate).x
    noise = 1e-7 * np.random.default_rng(0).standard_normal(n)
    recording = fj.Recording(name="run", sample_rate=rate, u=u, x=np.asarray(x) + noise)
    case = fj.Case(name="small", plant=fj.Plant(motor_constant=16.0), recordings=(recording,))
    names = {"fj": fj, "case": case}
    exec(compile(code[code.index("friction = ") :], str(README), "exec"), names)
    inertia = names["result"].parameters["J"]
    assert abs(inertia.value - 0.9) < 5.0 * inertia.stderr < 0.01
    assert capsys.readouterr().out
