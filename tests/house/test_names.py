"""Names: the public ones are listed once, documented, and loaded late; no class shares its name with another one."""

import ast
import importlib
import inspect
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_house import DOORS, home_of, public_names

import frictionjax

CONTRACT = {
    *("LuGre", "Drive", "simulate", "linearize", "excitation", "estimate_frf", "fit_sk"),
    *("load_case", "fit", "diagnose"),
}
"""Names that outside programs use: never renamed."""

EXPECTED = sorted(
    {
        *CONTRACT,
        *("Case", "Plant", "Recording", "audit", "case_from_files", "catalogue", "recording_from_frame"),
        *("Diagnosis", "Effort", "Estimate", "FRF", "FitResult", "Rule", "Trajectory"),
        *("BLA", "Resonances", "ZeroAmplitude"),
        *("best_linear_approximation", "extrapolate_to_zero_amplitude", "resonances"),
        *("Study", "Axis", "Factorial", "RandomDesign", "SobolDesign", "Experiment"),
        *("CompiledTask", "PythonTask", "SimulationTask", "ResponseTask", "FitTask", "DiagnosisTask"),
        "DiscriminationTask",
        *("run_study", "load_study", "summarise", "level_sweep", "compare_estimators", "check_diagnosis"),
        *("Calibration", "calibration_of", "calibration_study"),
        *("configure_jax", "simulate_batch", "simulate_closed_loop", "simulate_imposed", "Controller"),
        *("Observation", "Gaussian", "Cauchy", "Huber", "Replicas", "fit_many"),
        *("Given", "GivenEffect", "GivenModel"),
        *("Profile", "profile_likelihood", "Bootstrap", "bootstrap"),
        *("Information", "fisher_information", "Identifiability", "identifiability"),
        "hold_out_last_third",
        *("Ranking", "rank_experiments", "Discrimination", "rank_for_discrimination"),
        *("DesignedMultisine", "optimise_multisine"),
        *("load_fit", "save_fit", "save_diagnosis", "load_diagnosis", "plot", "MujocoJoint", "mujoco_joint"),
        *(
            "KnownJoint",
            "read_mujoco_joint",
            "JointModel",
            "bam_parameters",
            "isaac_lab_actuator",
            "urdf_dynamics",
        ),
        *("ArmDiagnosis", "ArmLog", "JointDiagnosis", "RigidBodyFit"),
        *("diagnose_arm", "fit_rigid_body", "read_arm_log", "save_arm_diagnosis"),
        *("FrictionjaxWarning", "InputError", "PrecisionError", "warm"),
    }
)
"""Every public name. A new one is added here on purpose."""


PACKAGE = Path(frictionjax.__file__).parent


def classes_of(text: str) -> Iterator[str]:
    """The classes of one file, wherever they stand in it; those with a leading underscore are its own affair."""
    nodes = ast.walk(ast.parse(text))
    return (node.name for node in nodes if isinstance(node, ast.ClassDef) and not node.name.startswith("_"))


def aliases_of(text: str) -> Iterator[str]:
    """The types that one file names by an assignment at its top, as in `Positions = Float[np.ndarray, "n j"]`."""
    assigned = (node for node in ast.parse(text).body if isinstance(node, ast.Assign))
    names = (target.id for node in assigned for target in node.targets if isinstance(target, ast.Name))
    return (name for name in names if name[0].isupper() and not name.isupper())


def shared_names(files: dict[str, str]) -> list[str]:
    """A sentence for each class of the `files`, text by name, whose name is also that of another class or type."""
    classes, others = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    for file, text in files.items():
        for name in classes_of(text):
            classes[name].append(file)
        for name in aliases_of(text):
            others[name].append(file)
    homes = {name: own + others[name] for name, own in classes.items()}
    return [f"{name} stands in {', '.join(own)}." for name, own in sorted(homes.items()) if len(own) > 1]


def _run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_public_names_are_these():
    api = importlib.import_module("frictionjax.api")
    assert sorted(api.__all__) == EXPECTED
    assert set(EXPECTED) >= CONTRACT


def test_a_class_shares_its_name_with_no_other_one():
    """Whoever meets a name need not look which class it is."""
    assert shared_names({str(path): path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}) == []


def test_shared_names_are_found():
    files = {
        "a.py": "class Grid: ...\nclass _Own: ...",
        "b.py": "def f():\n    class Grid: ...\nclass _Own: ...",
        "c.py": "class Place: ...\nGRID = 1",
        "d.py": "Place = tuple[int, int]\nclass Gains: ...",
    }
    assert shared_names(files) == ["Grid stands in a.py, b.py.", "Place stands in c.py, d.py."]


def test_every_public_name_is_there_and_documented():
    undocumented = []
    for name in importlib.import_module("frictionjax.api").__all__:
        value = getattr(frictionjax, name)
        documented = inspect.ismodule(value) or callable(value)
        if documented and not (inspect.getdoc(value) or "").strip():
            undocumented.append(name)
    assert undocumented == []


def test_dir_lists_the_public_names():
    assert set(dir(frictionjax)) >= set(EXPECTED)


def test_an_unknown_name_raises_a_sentence():
    with pytest.raises(
        AttributeError, match=r"frictionjax has no public name `friction_model`\. Public names: .*LuGre"
    ):
        _ = frictionjax.friction_model


@pytest.mark.parametrize("door", DOORS)
def test_a_door_offers_only_what_is_ours(door):
    module = importlib.import_module(door)
    # With `--types`, jaxtyping puts its own name into every module that it checks.
    names = [name for name in public_names(door) if name != "jaxtyping"]
    leaks = {name: home_of(getattr(module, name)) for name in names}
    assert {name: home for name, home in leaks.items() if home != "frictionjax"} == {}


def test_importing_the_package_does_not_wait_for_jax():
    loaded = _run("import sys, frictionjax; frictionjax.__version__; print(*sys.modules)").split()
    assert not {"jax", "frictionjax.api"} & set(loaded)


def test_help_does_not_wait_for_jax():
    code = """
import sys
from frictionjax.cli import main
try:
    main(["--help"])
except SystemExit as stop:
    assert not stop.code
print(*sys.modules)
"""
    text, loaded = _run(code).rstrip().rsplit("\n", 1)
    assert "diagnose" in text
    assert not {"jax", "frictionjax.api"} & set(loaded.split())


def test_importing_the_public_names_leaves_the_settings_of_jax_alone_and_loads_no_window():
    code = """
import jax
before = dict(jax.config.values)
import frictionjax.api, sys
print(before == jax.config.values, *{"matplotlib.pyplot", "pandas", "xarray"} & set(sys.modules))
"""
    assert _run(code).strip() == "True"


def test_importing_the_public_names_computes_nothing():
    """What JAX computes before its settings are made is slow for the whole process, and in single precision."""
    code = """
import frictionjax.api, jax
jax.config.update("jax_num_cpu_devices", 3)  # raises once anything was computed
print(len(jax.devices()))
"""
    assert _run(code).strip() == "3"
