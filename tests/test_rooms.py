"""The drawing of the rooms is that of the code, and says no less than it."""

from __future__ import annotations

import pytest

from rooms import ROOT, drawing, drawn, lines_at, lines_now, reach, reduced


def test_the_page_has_the_arrows_of_the_code() -> None:
    assert drawn() == drawing(), "run 'make rooms'"


def test_a_reduced_graph_leads_to_the_same_rooms() -> None:
    graph = {"a": {"b", "c", "d"}, "b": {"c"}, "c": {"d"}}
    few = reduced(graph)
    assert few == {"a": {"b"}, "b": {"c"}, "c": {"d"}}
    assert all(reach(few, room) == reach(graph, room) for room in graph)


def test_lines_are_counted_alike_now_and_then() -> None:
    now = lines_now()
    assert now["core"] > 100 and now.total() == sum(now.values())
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    assert set(lines_at("HEAD")) & set(now)
