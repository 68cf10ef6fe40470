"""Damaged files of every format are read or refused in one line (``simrig stability --files``)."""

from __future__ import annotations

from pathlib import Path

import pytest

from simrig.evaluation.stability.files import FilesReport, stability_of_files


@pytest.mark.slow
def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    found = stability_of_files(20.0, folder=tmp_path)
    assert found.total > 100 and found.refused and found.read
    assert not found.defects, found.kept


def test_what_else_happens_is_counted_and_one_file_is_kept() -> None:
    report = FilesReport()
    for outcome in ("read", "refused", "KeyError in f: x", "KeyError in f: x"):
        report.add({"kind": "hdf5", "outcome": outcome, "kept": "a.h5"})
    assert (report.total, report.read, report.refused) == (4, 1, 1)
    assert report.defects == {"KeyError in f: x": 2} and report.formats == {"hdf5": 4}
