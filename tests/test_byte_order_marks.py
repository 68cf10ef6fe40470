"""Text that an editor of another system has saved begins with a mark of its encoding."""

from __future__ import annotations

from pathlib import Path

import pytest

from simrig.files.text import read_text


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1"])
def test_a_byte_order_mark_is_no_text(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "scatter.txt"
    path.write_bytes(b"\xef\xbb\xbfVARS theta_i\r\n1 2\r\n")
    assert read_text(path, "ASTM", encoding).splitlines() == ["VARS theta_i", "1 2"]
