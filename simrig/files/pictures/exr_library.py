"""What the OpenEXR library prints while it reads, caught: it is how damage is reported.

The binding prints a warning for chunks that are missing or broken and returns what was in memory;
the library writes to the error stream. Neither belongs on a user's terminal.
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


@contextmanager
def watched() -> Iterator[io.StringIO]:
    """Give a buffer of what the binding prints, and keep the error stream quiet meanwhile."""
    with (
        _one_at_a_time,
        tempfile.TemporaryFile() as sink,
        redirect_stdout(io.StringIO()) as printed,
    ):
        sys.stderr.flush()
        errors = os.dup(2)
        os.dup2(sink.fileno(), 2)
        try:
            yield printed
        finally:
            os.dup2(errors, 2)
            os.close(errors)
