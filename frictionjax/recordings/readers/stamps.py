"""Dates with a time of day, and times of day alone, as loggers write them, in seconds since the first one."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import lru_cache

_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,](?P<part>\d+))?(?: ?(?P<half>[AP]M))?"
_ISO = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?", re.ASCII | re.IGNORECASE
)
_OTHERS = tuple(
    re.compile(date + _CLOCK, re.ASCII | re.IGNORECASE)
    for date in (
        r"(?P<year>\d{4})/(?P<month>\d\d?)/(?P<day>\d\d?)[T ] ?",
        r"(?P<day>\d\d?)\.(?P<month>\d\d?)\.(?P<year>\d{4}|\d\d)[T ] ?",
        r"(?P<first>\d\d?)[/-](?P<other>\d\d?)[/-](?P<year>\d{4}|\d\d),?[T ] ?",
        "",
    )
)
_DAY = 86_400.0


def is_stamp(field: str) -> bool:
    """Whether a field is a date with a time of day (2024-03-01T12:00:00.5, 01.03.2024 12:00:00, 3/1/2024 1:00:00 PM),
    or a time of day.

    **Arguments:**

    - `field`: its text.
    """
    return bool(_ISO.fullmatch(field)) or any(one.fullmatch(field) for one in _OTHERS)


def seconds_between(first: str, field: str) -> float:
    """Time from one stamp to another of the same form, s.

    Where day and month are in an order that the stamp does not say, the one in which less time lies between; a time of
    day alone before the first is that of the next day.

    **Arguments:**

    - `first`: the first stamp of a column.
    - `field`: another, or the same.

    **Returns:** s.

    **Raises:** `ValueError` for a date that does not exist, and stamps of different forms.
    """
    starts, ends = _known(first), dict(_readings(field))
    found = [(ends[order] - starts[order]).total_seconds() for order in starts if order in ends]
    if not found:
        raise ValueError(f"{field!r} has no date that exists, or another form than {first!r}")
    time = min(found, key=abs)
    return time + _DAY if time < 0.0 and "clock" in starts else time


@lru_cache(maxsize=64)
def _known(first: str) -> dict[str, datetime]:
    """The readings of the first stamp of a column, which are asked for at every line."""
    return dict(_readings(first))


def _readings(field: str) -> Iterator[tuple[str, datetime]]:
    """Each reading of a stamp: by which order of day and month, and the instant; impossible ones are left out."""
    if _ISO.fullmatch(field):
        try:
            instant = datetime.fromisoformat(field.upper().replace(",", "."))
        except ValueError:
            return
        yield "known", instant.replace(tzinfo=instant.tzinfo or UTC)
        return
    parts = next((found for one in _OTHERS if (found := one.fullmatch(field))), None)
    if parts is None:
        return
    known = parts.groupdict()
    if "first" in known:
        orders = {"month first": ("first", "other"), "day first": ("other", "first")}
    else:
        orders = {"known" if "day" in known else "clock": ("month", "day")}
    for order, (month, day) in orders.items():
        try:
            yield order, _instant(known, known.get(month) or "1", known.get(day) or "1")
        except ValueError:  # the thirteenth month
            continue


def _instant(known: dict[str, str | None], month: str, day: str) -> datetime:
    """The instant of the parts that are `known` of a stamp, with a `month` and a `day`."""
    year = int(known.get("year") or 2000)
    hour, half = int(known["hour"] or 0), (known["half"] or "").upper()
    if half:
        hour = hour % 12 + 12 * (half == "PM")
    part = int(((known["part"] or "") + "000000")[:6])
    year += 2000 * (year < 100)
    return datetime(
        year, int(month), int(day), hour, int(known["minute"] or 0), int(known["second"] or 0), part, UTC
    )
