"""Virtual observers take part while the server is killed; what they answered is analysed."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal
from simrig.perception.observer import BANDS, Observer, band_contrasts
from web_folders import small_experiment

SUBJECTS = 12


@pytest.fixture(scope="session")
def postgresql(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A PostgreSQL of our own; its URL."""
    places = [Path(p) for p in os.environ.get("PATH", "").split(":")]
    places += sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    found = next((p for p in places if (p / "initdb").exists() and (p / "postgres").exists()), None)
    if found is None:
        pytest.skip("no PostgreSQL here: apt-get install postgresql")
    pytest.importorskip("psycopg", reason="needs simrig[postgresql]")
    base = tmp_path_factory.mktemp("postgresql")
    folder = base / "data"
    user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
    if user:
        for above in (base, *base.parents[:2]):
            above.chmod(0o755)
        shutil.chown(base, "postgres")
    port = str(54000 + os.getpid() % 1000)
    tool = lambda name, *words: subprocess.run(  # noqa: E731
        [*user, str(found / name), *words], check=True, capture_output=True, timeout=120, cwd="/"
    )
    tool("initdb", "-D", str(folder), "-U", "simrig", "-A", "trust", "--no-sync")
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories=''"
    tool("pg_ctl", "-D", str(folder), "-w", "-o", options, "-l", str(base / "log"), "start")
    try:
        yield f"postgresql://simrig@127.0.0.1:{port}/postgres"
    finally:
        tool("pg_ctl", "-D", str(folder), "-m", "immediate", "stop")


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A folder whose server was killed twice, and its tables."""
    base = tmp_path_factory.mktemp("loaded")
    small_experiment(base / "experiment")
    options = ("--subjects", str(SUBJECTS), "--kills", "2", "--think", "0.1")
    found = done("experiment", "load", base / "experiment", *options)
    _nothing_lost(found)
    assert found["kills"] == 2 and found["retries"] > 0 and found["duplicates"] > 0
    done("experiment", "export", base / "experiment", "-o", base / "tables")
    return base / "experiment", base / "tables"


def _nothing_lost(found: dict) -> None:
    assert found["acknowledged"] == found["stored"] == SUBJECTS * 6
    assert found["lost"] == found["errors"] == 0, found["first_errors"]
    assert found["finished"] == SUBJECTS


@pytest.mark.slow
def test_nothing_is_lost_on_postgresql(postgresql: str, tmp_path: Path) -> None:
    small_experiment(tmp_path / "experiment", 270)
    options = ("--subjects", str(SUBJECTS), "--kills", "1", "--think", "0.05")
    found = done("experiment", "load", tmp_path / "experiment", *options, "--database", postgresql)
    _nothing_lost(found)
    assert found["database"] == "postgresql" and found["kills"] == 1
    tables = tmp_path / "tables"
    said = done(
        "experiment", "export", tmp_path / "experiment", "-o", tables, "--database", postgresql
    )
    assert said["answers"] == SUBJECTS * 6


@pytest.mark.slow
def test_tables_are_tidy_and_say_what_was_agreed_to(loaded: tuple[Path, Path]) -> None:
    with (loaded[1] / "answers.csv").open(newline="") as handle:
        answers = list(csv.DictReader(handle))
    with (loaded[1] / "subjects.csv").open(newline="") as handle:
        subjects = list(csv.DictReader(handle))
    assert len(answers) == SUBJECTS * 6 and len(subjects) == SUBJECTS
    assert len({s["consent_version"] for s in subjects}) == 1
    assert {s["observer"] for s in subjects} == {"virtual"}
    assert sum(row["repeat"] == "1" for row in answers) == SUBJECTS
    for row in answers:  # B.3, with the size that was shown
        scale = float(row["shown_mm"]) / 370.07
        sizes = [scale * 0.6 * float(row["structure_mm"]) / (0.6 + 0.35 * k) for k in range(12)]
        assert int(row["k_max"]) == sum(size > float(row["pixel_mm"]) for size in sizes)


@pytest.mark.slow
def test_the_analysis_of_virtual_observers(loaded: tuple[Path, Path], tmp_path: Path) -> None:
    found = done("experiment", "analyse", loaded[1], "--bootstrap", "60", "-o", tmp_path / "out")
    assert found["observers"] == "virtual"
    stimuli = found["stimuli"]
    assert stimuli["board-1"]["mean_m"] < stimuli["board-3"]["mean_m"]
    for group in found["groups"].values():
        fitted = group["fits"]["censored_nearness"]
        low, high = fitted["d50_interval_m"]
        assert low <= fitted["d50_m"] * 1.02 and fitted["d50_m"] <= high * 1.02
        assert fitted["d25_m"] > fitted["d50_m"]
    assert {"results.json", "groups.png", "functions.png", "thresholds.png"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    beside = done(
        "experiment", "analyse", loaded[1], "--bootstrap", "0", "--beside", f"B={loaded[1]}"
    )
    assert beside["correlations"]["B"]["r"] == pytest.approx(1.0)
    assert beside["beside"]["B"]["board-3"]["mean_m"] == stimuli["board-3"]["mean_m"]
    larger = done("experiment", "analyse", loaded[1], "--bootstrap", "0", "--effective")
    ratio = larger["stimuli"]["board-3"]["mean_m"] / stimuli["board-3"]["mean_m"]
    assert ratio == pytest.approx(370.07 / 290.0, rel=0.01)


@pytest.mark.slow
def test_a_subject_is_deleted_with_everything(loaded: tuple[Path, Path], tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(loaded[0], folder)
    done("experiment", "delete", folder, "3")
    said = done("experiment", "export", folder, "-o", tmp_path / "tables")
    assert said == {"output": str(tmp_path / "tables"), "answers": 66, "subjects": SUBJECTS - 1}
    assert "no subject 3" in refusal("experiment", "delete", folder, "3")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("answers.csv", lambda t: t.replace("board-1,", "board-9,", 1), "not in experiment.toml"),
        ("answers.csv", lambda t: t.replace(",test,0,", ",test,0,x", 1), "line"),
        ("answers.csv", lambda t: t.replace("rt_ms", "time", 1), "lacks the column 'rt_ms'"),
        ("answers.csv", lambda t: t.splitlines()[0] + "\n", "holds no answers"),
        ("subjects.csv", lambda t: t.replace(",virtual,", ",robot,", 1), "neither person nor"),
        ("subjects.csv", lambda _: "\x00", "subjects.csv"),
        ("experiment.toml", lambda _: "x = [", "is no TOML"),
        ("features.csv", lambda _: "name,value\na,1\n", "needs a column 'stimulus'"),
    ],
)
def test_damaged_tables_are_refused_in_one_line(
    loaded: tuple[Path, Path], tmp_path: Path, file: str, change, said: str
) -> None:
    folder = tmp_path / "tables"
    shutil.copytree(loaded[1], folder)
    text = (folder / file).read_text()
    (folder / file).write_text(change(text))
    assert said in refusal("experiment", "analyse", folder)


def test_answers_of_people_are_excluded_as_in_the_thesis(tmp_path: Path) -> None:
    """One who does not see the large board at the end; one who measured in another unit."""
    small_experiment(tmp_path / "experiment", 270)
    folder = tmp_path / "tables"
    folder.mkdir()
    shutil.copy(tmp_path / "experiment" / "experiment.toml", folder)
    subjects, answers = [], []
    for subject, (last, first_mm) in enumerate([(12, 132.0), (11, 132.0), (12, 13.2)], 1):
        sizes = f"{first_mm},{first_mm},,{first_mm / 500},1,1920,1080,1,"
        subjects.append(f"{subject},person,2026-01-01,abc,1,6,0,{sizes}")
        for order, (mm, answer) in enumerate([(1, 2), (2, 3), (3, 5), (5, 9), (8, last)]):
            role = "exclude" if mm == 8 else "test"
            start = f"{subject},{order},board-{mm},board {mm},g,{mm},0,{role},0,{answer},{answer}"
            answers.append(f"{start},900,290,0.264,{4 * mm},0")
    header = (
        "subject,observer,day,consent_version,finished,answers,place,first_mm,second_mm,card_mm,"
    )
    header += "pixel_mm,ratio,viewport_x,viewport_y,calibrations,panel_id"
    (folder / "subjects.csv").write_text("\n".join([header, *subjects]) + "\n")
    header = (
        "subject,order,stimulus,material,group,structure_mm,rotation_deg,role,repeat,answer,label,"
    )
    header += "rt_ms,shown_mm,pixel_mm,k_max,blurred"
    (folder / "answers.csv").write_text("\n".join([header, *answers]) + "\n")
    found = done("experiment", "analyse", folder, "--bootstrap", "0")
    assert found["observers"] == "people" and found["subjects"] == 1
    filters = found["filters"]
    assert (filters["excluded_by_check"], filters["excluded_by_calibration"]) == (1, 1)
    assert filters["answers"] == 12 and filters["kept"] == 4
    assert found["checks"] == {"board-8": pytest.approx(2.0 / 3.0)}
    assert found["stimuli"]["board-5"]["mean_m"] == pytest.approx(0.6 + 8 * 0.35)
    json.dumps(found, allow_nan=False)


def test_an_observer_sees_less_with_pixels_distance_and_age() -> None:
    contrasts = np.where(np.arange(len(BANDS) - 1) > 8, 0.05, 0.0)  # fine structure
    own = Observer().visibility(contrasts, 0.15)
    for worse in (Observer(pixel_mm=0.6), Observer(viewing_m=1.2), Observer(age=80.0)):
        assert worse.visibility(contrasts, 0.15) < own
    assert Observer(threshold=2.0).visibility(contrasts, 0.15) == pytest.approx(own / 2.0)


def test_contrasts_are_found_in_the_band_of_a_grating() -> None:
    x = np.arange(256)
    for cycles in (6 / 256, 16 / 256, 50 / 256):
        grating = 0.5 * (1.0 + 0.3 * np.sin(2.0 * np.pi * cycles * x))[None].repeat(128, axis=0)
        found = band_contrasts(grating, np.full((1, 256), 0.5))
        band = int(np.searchsorted(BANDS, cycles)) - 1
        assert np.argmax(found) == band
        assert np.sqrt((found**2).sum()) == pytest.approx(0.3 / np.sqrt(2.0), rel=0.03)


def test_lapses_are_answers_by_chance() -> None:
    rng = np.random.default_rng(1)
    blind = Observer(lapses=0.5)
    given = [blind.answer(np.zeros(12), rng) for _ in range(2000)]
    assert np.mean([a > 0 for a in given]) == pytest.approx(0.5 * 12 / 13, abs=0.04)
