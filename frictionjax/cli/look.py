"""The commands that fit nothing: `check`, `case new`, `effects`, `explain`."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from frictionjax.cli.cases import case_file_text, case_of
from frictionjax.cli.terminal import Terminal, say, say_json

if TYPE_CHECKING:
    import argparse


def check(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax check`."""
    from frictionjax.core.json import plain_json
    from frictionjax.diagnosis.intake.coverage import not_shown
    from frictionjax.physics import catalogue
    from frictionjax.recordings import audit
    from frictionjax.report.recordings import draw_recordings

    case = case_of(arguments, needs_holdout=False)
    terminal.progress("examining", 0.5)
    audits = [audit(recording, case.plant) for recording in case.recordings]
    hidden = not_shown(case)
    shown = [name for name in catalogue() if name not in hidden]
    picture = draw_recordings(case, arguments.picture)
    terminal.close()
    if arguments.json:
        content = {"case": case.name, "plant": case.plant, "picture": str(picture), "could_show": shown}
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
    say(["", f"Drawn: {picture}"])
    say([f"Next: frictionjax diagnose, with the same files and options,{then} and --out DIR"])


def new_case(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax case new`."""
    from frictionjax.core import InputError

    if arguments.out is not None and arguments.out.exists():
        raise InputError(
            "exists and is not overwritten", file=arguments.out, cure="Choose another name for `--out`"
        )
    folder = Path() if arguments.out is None else arguments.out.parent
    if not folder.is_dir():
        raise InputError(
            "there is no such folder", file=folder, cure="Make it, or choose another name for `--out`"
        )
    for name in (*arguments.inputs, *arguments.holdout):
        if Path(name).suffix.lower() == ".toml":
            raise InputError("is a case file already", file=name, cure="Give recordings")
    case = case_of(arguments)
    terminal.close()
    text = case_file_text(case, arguments, folder)
    if arguments.out is not None:
        _write_new(text, arguments.out)
    if arguments.json:
        say_json(tomllib.loads(text))
    elif arguments.out is None:
        say([text.removesuffix("\n")])
    else:
        say([f"Written: {arguments.out}", f"Next: frictionjax diagnose {arguments.out} --out DIR"])


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


def effects(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax effects`."""
    from frictionjax.cli.catalogue import effect_json, effect_lines, effects_lines

    terminal.close()
    if arguments.json:
        say_json(effect_json(arguments.name))
    elif arguments.name is None:
        say(effects_lines())
    else:
        say(effect_lines(arguments.name))


def explain(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax explain`."""
    from frictionjax.report.load import explain_saved

    path = Path(arguments.verdict)
    found = explain_saved(path / "verdict.json" if path.is_dir() else path, arguments.effect)
    terminal.close()
    if arguments.json:
        say_json(found)
    else:
        say([found["explanation"]])
