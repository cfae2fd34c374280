"""The one way back: a method of a noun that belongs to a later step asks the front door when it is called.

`Diagnosis.save` writes what the report makes, and `.plot()` draws: no noun may import either. They name a public verb,
which is looked up in `frictionjax` at the call and never before.
"""

import importlib
from typing import Any


def public_verb(name: str) -> Any:
    """The public verb called `name`, from the front door of the package."""
    return getattr(importlib.import_module("frictionjax"), name)
