"""Bags of ROS 1 and ROS 2: `.bag`, `.db3` and `.mcap`, by rosbags."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.limits import most_bytes, too_large
from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import library
from frictionjax.recordings.words import shown

_LARGEST = 65_536
"""Bytes of the largest message that is unpacked; larger ones are images and the like."""
_LONGEST = 64
"""Numbers of the longest array in a message that is taken for channels."""
_NAMES = ("name", "joint_names")
"""Fields with the names of joints, to which the arrays beside them belong."""
_NO_CHANNELS = ("header", *_NAMES)


def open_bag(path: Path) -> ArrayTable:
    """Open a bag: of ROS 1, or one file of a bag of ROS 2, by SQLite or MCAP.

    Numbers in messages are channels with clocks of their own: of joint states `position`, `velocity`, `effort` where
    there is one joint, `joint.position` and so on of several, with the topic before it where two topics have a joint of
    that name; else `/topic.field`, and `/topic.field[0]` of arrays. The time of a message is its stamp, where it has
    one, else that of its record.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table.

    **Raises:** `InputError` where rosbags is absent, for a damaged file, messages of other systems, a bag without
    numbers, and more than the limit.
    """
    highlevel, typesys = library("rosbags.highlevel", path), library("rosbags.typesys", path)
    channels = _Channels()
    refused: dict[str, str] = {}
    types = typesys.get_typestore(typesys.Stores.LATEST)
    try:
        with highlevel.AnyReader([path], default_typestore=types) as bag:
            unpacked = 0
            for connection, recorded, raw in bag.messages():
                unpacked += len(raw)
                if unpacked > most_bytes():
                    raise too_large(shown(path, 200), "its unpacked content")
                if len(raw) > _LARGEST:
                    refused[connection.topic] = f"holds {shown(connection.msgtype)}, too large for channels"
                    continue
                message = bag.deserialize(raw, connection.msgtype)
                channels.take(connection.topic, _stamp(message) or recorded, message)
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file makes of the library
        raise InputError(
            f"is not a bag of ROS that can be read ({shown(error, 80)})",
            file=shown(path, 200),
            cure="Record topics of ROS (joint states), or export them as text",
        ) from None
    return channels.table(path, refused)


class _Channels:
    """The channels as messages bring them: (topic, joint, field) -> times, ns, and values."""

    def __init__(self) -> None:
        self.found: dict[tuple[str, str, str], tuple[list[int], list[float]]] = {}

    def take(self, topic: str, time: int, message: Any) -> None:
        """Keep the numbers of a `message` of a `topic` at a `time`, ns."""
        for joint, field, value in _numbers(message):
            times, values = self.found.setdefault((topic, joint, field), ([], []))
            times.append(time)
            values.append(value)

    def table(self, path: Path, refused: dict[str, str]) -> ArrayTable:
        """The table of the bag at `path`; `refused`: topics without channels, with the reason."""
        collected = Collected("channel")
        collected.refused |= refused
        first = min((min(times) for times, _ in self.found.values()), default=0)
        joints = {(topic, joint) for topic, joint, _ in self.found if joint}
        for (topic, joint, field), (times, values) in self.found.items():
            alone = sum(joint == other for _, other in joints) == 1
            name = f"{'' if alone else f'{topic}/'}{joint}.{field}" if joint else f"{topic}.{field}"
            if joint and len(joints) == 1:
                name = field
            # In the order of the stamps: records are in that of their arrival.
            order = np.argsort(np.asarray(times), kind="stable")
            collected.columns[name] = partial(np.asarray, np.asarray(values, dtype=np.float64)[order])
            collected.clocks[name] = partial(np.asarray, 1e-9 * (np.asarray(times)[order] - first))
        return collected.table(path)


def _stamp(message: Any) -> int:
    """The stamp in the header of a message, ns; 0 where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else 1_000_000_000 * int(stamp.sec) + int(stamp.nanosec)


def _numbers(message: Any, before: str = "") -> Iterator[tuple[str, str, float]]:
    """Joint, field and value of each number in a message; the joint is empty where it names none."""
    joints = next((value for name in _NAMES if isinstance(value := getattr(message, name, None), list)), [])
    for name in message.__dataclass_fields__:
        value, field = getattr(message, name), f"{before}{name}"
        if name in _NO_CHANNELS or name.startswith("__"):
            continue
        if isinstance(value, bool | int | float | np.number):
            yield "", field, float(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size <= _LONGEST:
            if joints and value.size == len(joints):
                yield from ((joint, field, float(one)) for joint, one in zip(joints, value, strict=True))
            else:
                yield from (("", f"{field}[{k}]", float(one)) for k, one in enumerate(value))
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numbers(value, f"{field}.")
