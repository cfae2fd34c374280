"""A round: one table of comparisons, and what was chosen in it. No models: they are referred to by their place."""

import dataclasses

from frictionjax.diagnosis.table import ComparisonTable, ModelComparison


@dataclasses.dataclass(frozen=True)
class Round:
    """One round of the selection.

    **Attributes:** `table`, `accepted` (row of it, or None), `rivals` (names that the recordings cannot tell from the
    accepted one), `together` (whether the model without the candidates is adequate once it is fitted to all
    recordings), `dropped` (why a candidate that is acceptable was not accepted; empty where none was), `settled` (row
    whose model was refitted against what it leaves itself, or None).
    """

    table: ComparisonTable
    accepted: int | None
    rivals: tuple[str, ...] = ()
    together: bool = False
    dropped: str = ""
    settled: int | None = None

    @property
    def row(self) -> ModelComparison:
        """The comparison of the accepted candidate. Raises `ValueError` where none was accepted."""
        if self.accepted is None:
            raise ValueError(f"Nothing was accepted in table {self.table.key}.")
        return self.table.rows[self.accepted]

    @property
    def reference(self) -> str:
        """How other tables refer to the accepted model."""
        return f"{self.table.key}.{self.accepted}"


def dropping(found: Round, why: str, *, together: bool = False) -> Round:
    """The round `found` with nothing accepted, and `why`; `together` as in `Round`."""
    return dataclasses.replace(found, accepted=None, rivals=(), together=together, dropped=why)
