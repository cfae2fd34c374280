"""Errors are sentences: what is wrong, where (file, line, column), and how to correct it."""


class InputError(ValueError):
    """Bad input from a user: one line that names the file, the place and the cure.

    **Arguments:**

    - `problem`: what is wrong, as a sentence.
    - `file`: the file in which it is wrong, if there is one.
    - `place`: line, column, key or variable inside that file.
    - `cure`: what the user should do, as a sentence.
    """

    def __init__(self, problem: str, *, file: object = None, place: str = "", cure: str = "") -> None:
        self.problem, self.file, self.place, self.cure = problem, file, place, cure
        where = ", ".join(str(part) for part in (file, place) if part)
        parts = [f"{where}: {problem}" if where else problem]
        if cure:
            parts.append(cure)
        super().__init__(" ".join(part if part.endswith((".", "?", "!")) else part + "." for part in parts))


class PrecisionError(RuntimeError):
    """Raised by the verbs when JAX runs in float32 (nanometres on a 10 mm stroke need float64)."""


class FrictionjaxWarning(UserWarning):
    """Something in the data or the fit that the reader of the result must know."""
