"""With `--types`, what the package says of its arguments is checked at every call."""

import pytest
from jaxtyping import TypeCheckError

from frictionjax.core import silent


def test_a_wrong_type_is_refused_where_types_are_checked(request):
    if not request.config.getoption("--types"):
        pytest.skip("types are checked with --types")
    with pytest.raises(TypeCheckError):
        silent("a stage", "half")
