"""What a section of the report is. A new panel is one class in one file, listed in `sections/__init__.py`."""

import abc

import equinox as eqx
from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis


class AbstractSection(eqx.Module):
    """One section of the report.

    **Attributes:**

    - `title`: its heading and its entry in the table of contents; empty for a section without a heading.
    """

    title: eqx.AbstractClassVar[str]

    @abc.abstractmethod
    def body(self, diagnosis: Diagnosis) -> Markup:
        """The section's content, without the heading; empty when there is nothing to say.

        **Arguments:**

        - `diagnosis`: what `diagnose` found.
        """
