"""`frictionjax arm`: the friction of each joint of a robot."""

from frictionjax.cli.kinds import AsJson, Column, File, Folder, Gigabytes, Hertz, Name, Screen, Several
from frictionjax.cli.terminal import say, say_json


def arm(
    logs: list[File],
    /,
    *,
    model: File,
    out: Folder,
    holdout: Several[File] = None,
    joints: Several[Name] = None,
    only: Several[Name] = None,
    q: Several[Column] = None,
    tau: Several[Column] = None,
    time: Column | None = None,
    sample_rate: Hertz | None = None,
    limit: Gigabytes | None = None,
    as_json: AsJson = False,
    terminal: Screen,
) -> None:
    r"""Name what is missing in the friction of each joint of a robot.

    Refit the rigid-body model of an arm to logs of all its joints, and diagnose what it leaves of each torque. Columns
    are found by their names: q1, tau1, ..., or elbow.position, elbow.effort.

    **Arguments:**

    - `logs`: logs to fit: time, positions and torques
    - `model`: the rigid bodies, as MuJoCo's XML or URDF
    - `out`: where index.html, arm.json and joints/ go
    - `holdout`: held-out logs, which judge the result (default: the last third of a single one)
    - `joints`: joints of the model, in the order of the log's columns (default: by the columns' names, else all)
    - `only`: joints to diagnose (default: all)
    - `q`: columns of the positions, in the order of the joints
    - `tau`: columns of the torques, in the order of the joints
    - `time`: the column of time
    - `sample_rate`: needed when logs have no time column
    - `limit`: the most that is read of one file, unpacked (default: 0.5)
    - `as_json`: print arm.json as JSON on stdout, and nothing else
    - `terminal`: where progress is shown

    **Examples:**

        frictionjax arm run1.csv run2.csv --holdout run3.csv --model robot.xml \
          --out result
        frictionjax arm log.mcap --model robot.urdf --only elbow wrist_1 --out result
        frictionjax arm log.csv --model robot.xml --q A B --tau C D \
          --joints shoulder elbow --out result
    """
    from frictionjax.api import diagnose_arm
    from frictionjax.report import arm_json, check_arm_writable

    check_arm_writable(out)
    columns = {"q": q, "tau": tau, "t": time}
    found = diagnose_arm(
        logs,
        model,
        holdout=holdout or (),
        joints=joints,
        only=only or (),
        columns={key: value for key, value in columns.items() if value},
        sample_rate=sample_rate,
        limit=limit,
        progress=terminal.progress,
    )
    terminal.progress("writing the report", 1.0)
    saved = found.save(out)
    terminal.close()
    for warning in found.warnings:
        terminal.warn(warning)
    if as_json:
        say_json(arm_json(found))
        return
    say(repr(found).splitlines())
    say(["", "Written:", *(f"  {saved / name}" for name in ("index.html", "arm.json", "joints"))])
