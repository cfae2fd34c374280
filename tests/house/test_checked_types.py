"""With `--types`, what the package says of its arguments is checked at every call."""

from pathlib import Path

import pytest
from jaxtyping import TypeCheckError

from frictionjax.core import silent


def test_a_wrong_type_is_refused_where_types_are_checked(request):
    if not request.config.getoption("--types"):
        pytest.skip("types are checked with --types")
    with pytest.raises(TypeCheckError):
        silent("a stage", "half")


def test_every_package_is_checked(request):
    (conftest,) = (p for p in request.config.pluginmanager.get_plugins() if hasattr(p, "TYPED"))
    package = Path(__file__).parents[2] / "frictionjax"
    assert sorted(conftest.TYPED) == sorted(door.parent.name for door in package.glob("*/__init__.py"))
