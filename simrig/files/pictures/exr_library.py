"""What the OpenEXR library prints while it reads, caught: it is how damage is reported.

The binding prints a warning for chunks that are missing or broken and returns what was in memory;
the library and its codecs write to the process's own output. None of that belongs on a user's
terminal, and all of it means that the file is damaged.
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

_one_at_a_time = threading.RLock()
_MOST = 4096


@contextmanager
def watched() -> Iterator[io.StringIO]:
    """Give a buffer that holds, after the block, what the library printed in it."""
    with (
        _one_at_a_time,
        tempfile.TemporaryFile() as sink,
        redirect_stdout(io.StringIO()) as printed,
    ):
        for stream in (sys.__stdout__, sys.stderr):
            if stream is not None:
                stream.flush()
        kept = [(number, os.dup(number)) for number in (1, 2)]
        for number, _ in kept:
            os.dup2(sink.fileno(), number)
        try:
            yield printed
        finally:
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
            sink.seek(0)
            printed.write(sink.read(_MOST).decode("utf-8", "replace"))
