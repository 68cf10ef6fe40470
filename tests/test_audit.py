"""Folders of scenes: planned, rendered, checked, and refused where they are none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from command_line import done, refusal

SCENE = """<scene version="3.0.0"><sensor type="perspective"><transform name="to_world">
<lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film>
</sensor><shape type="sphere"><bsdf type="diffuse"/></shape>
<emitter type="point"><point name="position" x="2" y="3" z="4"/></emitter></scene>"""


@pytest.mark.usefixtures("in_empty_folder")
def test_every_scene_of_a_folder_has_its_row() -> None:
    Path("all/parts").mkdir(parents=True)
    Path("all/good.xml").write_text(SCENE)
    Path("all/bad.xml").write_text(SCENE.replace("diffuse", "no_such_plugin"))
    Path("all/open.xml").write_text(SCENE.replace('value="32"', 'value="$size"'))
    Path("all/parts/ball.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    data = done("audit", "all", "--tolerance", "dE=4", "--scale", "0.5", "--reference-seconds", "1")
    rows = {row["scene"]: row for row in data["scenes"]}
    assert set(rows) == {"good.xml", "bad.xml", "open.xml"}, "a fragment has no sensor"
    assert rows["good.xml"]["verdict"] == "kept" and rows["good.xml"]["measured"] <= 4.0
    assert "no_such_plugin" in rows["bad.xml"]["settings"]
    assert "-D size=VALUE" in rows["open.xml"]["settings"]
    assert (data["summary"]["kept"], data["summary"]["refused"]) == (1, 2)
    told = done("audit", "all", "--budget", "0.1s", "-D", "size=16")
    assert told["summary"]["refused"] == 1
    assert told["summary"]["not told"] == 2


@pytest.mark.usefixtures("in_empty_folder")
def test_a_record_is_gone_on_behind_and_of_one_question() -> None:
    Path("all").mkdir()
    Path("all/a.xml").write_text(SCENE)
    Path("all/b.xml").write_text(SCENE)
    asked = ("audit", "all", "--budget", "0.1s", "-o", "rows.jsonl")
    done(*asked)
    lines = Path("rows.jsonl").read_text().splitlines()
    first = {**json.loads(lines[1]), "settings": "as it was"}
    Path("rows.jsonl").write_text(f"{lines[0]}\n{json.dumps(first)}\n{lines[2][:20]}")
    rows = done(*asked)["scenes"]
    assert rows[0]["settings"] == "as it was", "not asked again"
    assert rows[1]["verdict"] == "not told"
    assert len(Path("rows.jsonl").read_text().splitlines()) == 3
    assert "choose another file" in refusal(*asked, "--scale", "0.5")
    Path("rows.jsonl").write_text("no record")
    assert "no record of an audit" in refusal(*asked)
    assert "cannot keep the record" in refusal(*asked[:-1], "no_folder/rows.jsonl")


@pytest.mark.usefixtures("in_empty_folder")
def test_what_is_no_folder_of_scenes_is_refused() -> None:
    assert "there is no folder" in refusal("audit", "nowhere")
    Path("empty").mkdir()
    assert "no scene file" in refusal("audit", "empty")
    assert "no time" in refusal("audit", "empty", "--budget", "soon")
