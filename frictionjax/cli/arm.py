"""`frictionjax arm`: the friction of each joint of a robot."""

from typing import TYPE_CHECKING

from frictionjax.cli.terminal import Terminal, say, say_json

if TYPE_CHECKING:
    import argparse


def arm(arguments: "argparse.Namespace", terminal: Terminal) -> None:
    """`frictionjax arm`."""
    from frictionjax.api import diagnose_arm
    from frictionjax.report import arm_json, check_arm_writable

    check_arm_writable(arguments.out)
    columns = {"q": arguments.q, "tau": arguments.tau, "t": arguments.time}
    found = diagnose_arm(
        arguments.inputs,
        arguments.model,
        holdout=arguments.holdout,
        joints=arguments.joints or None,
        only=arguments.only,
        columns={key: value for key, value in columns.items() if value},
        sample_rate=arguments.sample_rate,
        limit=arguments.limit,
        progress=terminal.progress,
    )
    terminal.progress("writing the report", 1.0)
    saved = found.save(arguments.out)
    terminal.close()
    for warning in found.warnings:
        terminal.warn(warning)
    if arguments.json:
        say_json(arm_json(found))
        return
    say(repr(found).splitlines())
    say(["", "Written:", *(f"  {saved / name}" for name in ("index.html", "arm.json", "joints"))])
