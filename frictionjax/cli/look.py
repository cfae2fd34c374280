"""The commands that fit nothing: `check`, `case new`, `effects`, `explain`."""

import tomllib
from pathlib import Path
from typing import Annotated

from frictionjax.cli.case_options import CaseOptions
from frictionjax.cli.cases import case_file_text, case_of
from frictionjax.cli.kinds import EFFECT, AsJson, File, Screen
from frictionjax.cli.terminal import say, say_json


def check(
    files: list[File],
    /,
    *,
    picture: File = Path("frictionjax-check.png"),
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    """Read files, draw them, say what they contain and what could be learnt.

    Read recordings as `diagnose` would, without fitting anything: sampling, noise, regimes of friction, faults, and
    which effects these recordings could show.

    **Arguments:**

    - `files`: one case file (.toml), or the recordings to fit
    - `picture`: where the recordings are drawn, as PNG
    - `as_json`: print what is printed as JSON on stdout, and nothing else
    - `source`: what a case file would say
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax check run1.csv run2.csv
        frictionjax check case.toml --picture case.png
    """
    from frictionjax.core.json import plain_json
    from frictionjax.diagnosis.intake.coverage import not_shown
    from frictionjax.physics import catalogue
    from frictionjax.recordings import audit
    from frictionjax.report.recordings import draw_recordings

    case = case_of(files, source, needs_holdout=False)
    terminal.progress("examining", 0.5)
    audits = [audit(recording, case.plant) for recording in case.recordings]
    hidden = not_shown(case)
    shown = [name for name in catalogue() if name not in hidden]
    drawn = draw_recordings(case, picture)
    terminal.close()
    if as_json:
        content = {"case": case.name, "plant": case.plant, "picture": str(drawn), "could_show": shown}
        content |= {"cannot_show": hidden, "recordings": audits}
        say_json(plain_json(content))
        return
    for recording, found in zip(case.recordings, audits, strict=True):
        say([f"{recording.name} ({'fitted' if recording.role == 'fit' else 'held out'}):"])
        say(f"  {sentence}" for sentence in found.sentences())
        say([""])
    say(["The fitted recordings could show:", f"  {', '.join(shown) or 'no effect'}"])
    if hidden:
        say(["They cannot show:", *(f"  {name}: {reason}" for name, reason in hidden.items())])
    held_out = any(recording.role == "holdout" for recording in case.recordings)
    then = "" if held_out else ' one of them held out (--holdout FILE; in a case file role = "holdout"),'
    say(["", f"Drawn: {drawn}"])
    say([f"Next: frictionjax diagnose, with the same files and options,{then} and --out DIR"])


def new_case(
    files: list[File],
    /,
    *,
    out: File | None = None,
    as_json: AsJson = False,
    source: CaseOptions = CaseOptions(),
    terminal: Screen,
) -> None:
    """Write a commented case file for recordings.

    Read recordings and print a case file for them, with every key explained.

    **Arguments:**

    - `files`: the recordings to fit
    - `out`: write it there, unless it exists, and not to stdout
    - `as_json`: print its keys as JSON on stdout, and nothing else
    - `source`: what the case file says
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax case new run1.csv run2.csv --holdout run3.csv > case.toml
    """
    from frictionjax.core import InputError

    if out is not None and out.exists():
        raise InputError("exists and is not overwritten", file=out, cure="Choose another name for `--out`")
    folder = Path() if out is None else out.parent
    if not folder.is_dir():
        raise InputError(
            "there is no such folder", file=folder, cure="Make it, or choose another name for `--out`"
        )
    for name in (*files, *(source.holdout or ())):
        if name.suffix.lower() == ".toml":
            raise InputError("is a case file already", file=name, cure="Give recordings")
    case = case_of(files, source)
    terminal.close()
    text = case_file_text(case, files, source, folder)
    if out is not None:
        _write_new(text, out)
    if as_json:
        say_json(tomllib.loads(text))
    elif out is None:
        say([text.removesuffix("\n")])
    else:
        say([f"Written: {out}", f"Next: frictionjax diagnose {out} --out DIR"])


def _write_new(text: str, path: Path) -> None:
    """Write `text` into a file that is not there yet."""
    from frictionjax.core import InputError

    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})", file=path, cure="Choose another name for `--out`"
        ) from error


def effects(
    name: Annotated[str | None, EFFECT] = None, /, *, as_json: AsJson = False, terminal: Screen
) -> None:
    """List the effects that can be named, or describe one.

    The catalogue of effects: what each is, where it shows, what it is confused with.

    **Arguments:**

    - `name`: the effect to describe
    - `as_json`: print the same as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax effects
        frictionjax effects creep
    """
    from frictionjax.cli.catalogue import effect_json, effect_lines, effects_lines

    terminal.close()
    if as_json:
        say_json(effect_json(name))
    elif name is None:
        say(effects_lines())
    else:
        say(effect_lines(name))


def explain(
    verdict: File, effect: Annotated[str, EFFECT], /, *, as_json: AsJson = False, terminal: Screen
) -> None:
    """Why an effect was named or not.

    Read a verdict and say why an effect was named in it, was not, or could not be tested.

    **Arguments:**

    - `verdict`: verdict.json, or the folder that holds it
    - `effect`: the name of an effect
    - `as_json`: print the same as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax explain result creep
    """
    from frictionjax.report.load import explain_saved

    found = explain_saved(verdict / "verdict.json" if verdict.is_dir() else verdict, effect)
    terminal.close()
    if as_json:
        say_json(found)
    else:
        say([found["explanation"]])
