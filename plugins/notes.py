"""What Mitsuba warns of while it builds a scene: once, in one line, through ``logging``.

Mitsuba writes its warnings to the terminal with a time, a class and colours, whenever a scene is
loaded, and a plan loads one in several variants.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mitsuba as mi

_log = logging.getLogger(__name__)
_PREFIX = re.compile(r"^[\d-]+ [\d:]+ +WARN +(?:\w+ +)?\[(\w+).*?\] *")
# what a warning is, and what it means to who renders
_MEANINGS = (
    (
        re.compile(r'texture named "(.*)" contains pixels that exceed'),
        "the texture '{0}' holds values outside 0 to 1, which no reflectance has; raw = true says "
        "that they are none",
    ),
)


@contextmanager
def warnings_in_words() -> Iterator[None]:
    """Keep Mitsuba's warnings from the terminal, and tell each of them once."""
    logger = mi.logger()  # type: ignore[operator]  # the stub says object
    before = [logger.appender(index) for index in range(logger.appender_count())]
    logger.clear_appenders()
    logger.add_appender(_teller())
    try:
        yield
    finally:
        logger.clear_appenders()
        for appender in before:
            logger.add_appender(appender)


@cache
def _tell(text: str) -> None:
    _log.warning(text)


def said_of(warning: str) -> str:
    """Return what a line of Mitsuba's log means."""
    text = _PREFIX.sub("", warning.strip())
    for pattern, meaning in _MEANINGS:
        if found := pattern.search(text):
            return meaning.format(*found.groups())
    named = _PREFIX.match(warning.strip())
    return f"Mitsuba says of {named[1] if named else 'a scene'}: {' '.join(text.split())}"


@cache
def _teller() -> Any:
    class Teller(mi.Appender):
        def append(self, level: Any, text: str) -> None:
            if level >= mi.LogLevel.Warn:
                _tell(said_of(text))

        def log_progress(self, *_: Any) -> None:
            """Say nothing of progress: loading has little."""

    return Teller()
