"""Refusals as tests ask for them: of their class, with the words they need, in one line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from simrig.core.errors import SimrigError


def refused(words: str, call: Callable[..., Any], *arguments: Any, **named: Any) -> str:
    """Return the one line with which a call is refused, after looking for words in it."""
    with pytest.raises(SimrigError, match=words) as caught:
        call(*arguments, **named)
    line = str(caught.value)
    assert "\n" not in line
    return line
