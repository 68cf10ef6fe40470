"""The experiment's server: sessions, answers that are stored once, and everything it refuses."""

from __future__ import annotations

import hashlib
import importlib.resources
import itertools
import json
import socket
import sqlite3
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from command_line import done, refusal
from simrig.web.experiment.design import checked
from simrig.web.experiment.sessions import order_of
from web_folders import Running, served, small_experiment, small_table

CONSENT = checked(small_table()).consent_version
ANSWER = {"answer": 3, "rt_ms": 900.0, "shown_mm": 290.0, "pixel_mm": 0.27}
SIZE = {
    "first_mm": 132.0,
    "second_mm": 132.5,
    "pixel_mm": 0.27,
    "ratio": 1.0,
    "viewport_x": 1920.0,
    "viewport_y": 1080.0,
}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drawn") / "experiment"
    small_experiment(folder)
    return folder


@pytest.fixture
def server(drawn: Path) -> Iterator[Running]:
    (drawn / "answers.sqlite").unlink(missing_ok=True)
    running = served(drawn)
    yield running
    running.stop()


def begun(server: Running, **more: Any) -> str:
    status, said, _ = server.ask(
        "POST", "/api/session", {"consent": True, "version": CONSENT, **more}
    )
    assert status == 201
    return str(said["token"])


def answered(server: Running) -> str:
    """Take part to the end; return the token."""
    token = begun(server)
    assert server.ask("PUT", "/api/session/calibration", SIZE, token)[0] == 200
    for trial in server.ask("GET", "/api/session", token=token)[1]["open"]:
        assert server.ask("PUT", f"/api/session/answers/{trial}", ANSWER, token)[0] == 200
    return token


def rows_of(folder: Path, table: str) -> int:
    with sqlite3.connect(folder / "answers.sqlite") as connection:
        return int(connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0])


def test_a_session_from_consent_to_withdrawal(server: Running, drawn: Path) -> None:
    token = answered(server)
    status, said, _ = server.ask("POST", "/api/session/finish", token=token)
    assert status == 200 and len(said["code"]) == 22
    assert rows_of(drawn, "answers") == 6  # five boards and one repeat
    assert server.ask("POST", "/api/withdraw", {"code": said["code"] + "x"})[0] == 404
    assert server.ask("POST", "/api/withdraw", {"code": said["code"]})[0] == 200
    for table in ("subjects", "answers", "calibrations", "panel"):
        assert rows_of(drawn, table) == 0
    assert server.ask("GET", "/api/session", token=token)[0] == 401


def test_nothing_of_a_deleted_subject_is_left_in_the_files(server: Running, drawn: Path) -> None:
    token = begun(server, panel="panel-member-4711")
    holds = lambda: any(  # noqa: E731
        b"panel-member-4711" in path.read_bytes() for path in drawn.glob("answers.sqlite*")
    )
    assert holds()
    assert server.ask("DELETE", "/api/session", token=token)[0] == 200
    assert not holds()


def test_tokens_and_codes_are_stored_hashed_only(server: Running, drawn: Path) -> None:
    token = answered(server)
    code = server.ask("POST", "/api/session/finish", token=token)[1]["code"]
    stored = b"".join(path.read_bytes() for path in drawn.glob("answers.sqlite*"))
    assert token.encode() not in stored and code.encode() not in stored
    assert hashlib.sha256(token.encode()).hexdigest().encode() in stored


def test_the_same_answer_again_is_stored_once_and_another_is_refused(server: Running) -> None:
    token = begun(server)
    path = "/api/session/answers/0"
    assert [server.ask("PUT", path, ANSWER, token)[0] for _ in range(3)] == [200] * 3
    assert server.ask("PUT", path, ANSWER | {"answer": 4}, token)[0] == 409
    state = server.ask("GET", "/api/session", token=token)[1]
    assert state["open"] == [1, 2, 3, 4, 5]
    assert server.ask("POST", "/api/session/finish", token=token)[0] == 409


def test_a_session_says_its_own_order_and_no_answers_or_roles(server: Running) -> None:
    token = answered(server)
    said = json.dumps(server.ask("GET", "/api/session", token=token)[1])
    for word in ("rt_ms", "exclude", "structure", "board 8"):
        assert word not in said


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/api/session"),
        ("DELETE", "/api/session"),
        ("PUT", "/api/session/calibration"),
        ("PUT", "/api/session/answers/0"),
        ("POST", "/api/session/finish"),
    ],
)
def test_no_session_is_reached_without_its_token(server: Running, method: str, path: str) -> None:
    answered(server)
    body = SIZE if "calibration" in path else ANSWER if "answers" in path else None
    for token in (None, "", "x" * 43, "' OR 1=1 --" * 4, "x" * 5000):
        assert server.ask(method, path, body, token)[0] == 401


def test_one_subject_cannot_touch_the_answers_of_another(server: Running, drawn: Path) -> None:
    first, second = begun(server), begun(server)
    server.ask("PUT", "/api/session/answers/0", ANSWER, first)
    assert server.ask("PUT", "/api/session/answers/0", ANSWER | {"answer": 7}, second)[0] == 200
    assert server.ask("DELETE", "/api/session", token=second)[0] == 200
    assert rows_of(drawn, "answers") == 1
    assert server.ask("GET", "/api/session", token=first)[1]["open"] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    "change",
    [
        {"answer": 13},
        {"answer": -1},
        {"answer": 2.5},
        {"answer": "3"},
        {"answer": None},
        {"answer": 10**30},
        {"rt_ms": -1.0},
        {"rt_ms": "NaN"},
        {"shown_mm": 0.0},
        {"pixel_mm": 1e300},
        {"subject": 1},
        {"__proto__": {}},
    ],
)
def test_answers_that_cannot_be_are_refused_in_one_line(
    server: Running, change: dict[str, Any]
) -> None:
    token = begun(server)
    status, said, _ = server.ask("PUT", "/api/session/answers/0", ANSWER | change, token)
    assert status == 422
    assert "\n" not in said["error"] and len(said["error"]) <= 200
    assert server.ask("GET", "/api/session", token=token)[1]["open"] == list(range(6))


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[]", b"null", b"\xff\xfe", b'{"answer": NaN}', b"[" * 4000]
)
def test_bodies_that_are_no_answer_are_refused(server: Running, body: bytes) -> None:
    token = begun(server)
    assert server.ask("PUT", "/api/session/answers/0", body, token)[0] in (400, 422)


def test_trials_that_do_not_exist_are_refused(server: Running) -> None:
    token = begun(server)
    for trial, status in (("6", 404), ("-1", 404), ("1e3", 422), ("0%2F..", 404), ("9" * 40, 404)):
        assert server.ask("PUT", f"/api/session/answers/{trial}", ANSWER, token)[0] == status


def test_oversized_bodies_are_refused_before_they_are_read(server: Running) -> None:
    assert server.ask("POST", "/api/session", b" " * 9000)[0] == 413
    parts = urlsplit(server.origin)
    with socket.create_connection((str(parts.hostname), parts.port), timeout=10) as link:
        head = f"POST /api/session HTTP/1.1\r\nHost: {parts.netloc}\r\n"
        link.sendall((head + "Content-Length: 99999999999\r\n\r\n").encode())
        assert b"413" in link.recv(200)
    with socket.create_connection((str(parts.hostname), parts.port), timeout=10) as link:
        link.sendall((head + "Transfer-Encoding: chunked\r\n\r\n").encode())
        for _ in range(3):
            link.sendall(b"1000\r\n" + b"x" * 0x1000 + b"\r\n")
        assert b"413" in link.recv(200)


def test_requests_from_other_sites_and_names_are_refused(server: Running) -> None:
    body = {"consent": True, "version": CONSENT}
    evil = "https://evil.example"
    assert server.ask("POST", "/api/session", body, Origin=evil)[0] == 403
    assert server.ask("POST", "/api/session", body, Origin="null")[0] == 403
    assert server.ask("POST", "/api/session", body, Sec_Fetch_Site="cross-site")[0] == 403
    assert server.ask("GET", "/api/design", Sec_Fetch_Site="same-site")[0] == 403
    assert server.ask("GET", "/stimuli/board-1.png", Sec_Fetch_Site="cross-site")[0] == 403
    # a link from elsewhere may open the page itself
    linked = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate"}
    assert server.ask("GET", "/", **linked)[0] == 200
    for host in ("evil.example", "127.0.0.1", "evil.example:80", "", "127.0.0.1:1"):
        assert server.ask("GET", "/api/design", Host=host)[0] in (400, 421)
    assert server.ask("POST", "/api/session", body, Origin=server.origin)[0] == 201
    preflight = {"Origin": evil, "Access_Control_Request_Method": "POST"}
    status, _, headers = server.ask("OPTIONS", "/api/session", **preflight)
    assert status == 403 and "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "path",
    [
        "/stimuli/../experiment.toml",
        "/stimuli/..%2fexperiment.toml",
        "/stimuli/%2e%2e%2fanswers.sqlite",
        "/stimuli/..%5canswers.sqlite",
        "/stimuli/board-1.png%00.toml",
        "/stimuli//etc/passwd",
        "/stimuli/",
        "/answers.sqlite",
        "/experiment.toml",
        "/vendor/../../server.py",
        "/vendor/manifest.json",
        "/api/answers",
        "/api/subjects",
        "/api/export",
        "/docs",
        "/openapi.json",
        "//evil.example/",
    ],
)
def test_no_path_leads_to_a_file_that_is_not_meant(server: Running, path: str) -> None:
    status, said, _ = server.ask("GET", path)
    assert status == 404
    assert b"SQLite format" not in (said if isinstance(said, bytes) else b"")


def test_every_answer_carries_the_policy_and_no_cookie(server: Running) -> None:
    paths = (
        "/",
        "/experiment.js",
        "/api/design",
        "/api/session",
        "/nowhere",
        "/stimuli/board-1.png",
    )
    for path in paths:
        _, _, headers = server.ask("GET", path)
        assert headers["content-security-policy"].startswith(
            "default-src 'none'; script-src 'self'"
        )
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert "set-cookie" not in headers and "server" not in headers


def test_consent_is_asked_for_and_has_a_version(server: Running) -> None:
    for body in ({"version": CONSENT}, {"consent": False, "version": CONSENT}):
        assert server.ask("POST", "/api/session", body)[0] == 422
    assert server.ask("POST", "/api/session", {"consent": True, "version": "old"})[0] == 409


def test_too_many_requests_are_slowed_down(drawn: Path, tmp_path: Path) -> None:
    folder = tmp_path / "limited"
    small_experiment(
        folder, 270, limits={"starts_at_once": 3, "requests_at_once": 4, "subjects": 2}
    )
    running = served(folder)
    try:
        version = running.ask("GET", "/api/design")[1]["consent_version"]
        body = {"consent": True, "version": version}
        found = [running.ask("POST", "/api/session", body) for _ in range(4)]
        assert [status for status, _, _ in found] == [201, 201, 409, 429]
        token = found[0][1]["token"]
        states = [running.ask("GET", "/api/session", token=token)[0] for _ in range(8)]
        assert states[:4] == [200] * 4 and 429 in states
        other = found[1][1]["token"]  # is not slowed down by its neighbour
        assert running.ask("GET", "/api/session", token=other)[0] == 200
        assert int(found[3][2]["retry-after"]) >= 1
    finally:
        running.stop()


def test_orders_are_balanced() -> None:
    """Each stimulus stands once at every place and, over both directions, follows each equally."""
    table = small_table(repeats=[])
    for count in (4, 5):
        own = [dict(table["stimuli"][k], role="test") for k in range(count)]
        design = checked(table | {"stimuli": own})
        rows = [
            [t.stimulus.id for t in order_of(design, place)]
            for place in range(count * (1 + count % 2))
        ]
        for place in range(count):
            assert set(Counter(row[place] for row in rows).values()) == {len(rows) // count}
        after = Counter(pair for row in rows for pair in itertools.pairwise(row))
        assert len(after) == count * (count - 1) and len(set(after.values())) == 1


def test_the_vendored_files_are_those_of_the_release() -> None:
    vendor = importlib.resources.files("simrig.web.experiment") / "static" / "vendor"
    manifest = json.loads((vendor / "manifest.json").read_text())
    assert {p.name for p in vendor.iterdir()} == {*manifest, "manifest.json", "LICENSE"}
    for name, said in manifest.items():
        assert hashlib.sha256((vendor / name).read_bytes()).hexdigest() == said["sha256"]
        assert said["license"] == "MIT"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"answers": ["0", "1"]}, "12 distances need 13 answers"),
        ({"distances_m": [2.0, 1.0]}, "2 distances need 3 answers"),
        ({"repeats": ["nobody"]}, "'nobody' of repeats"),
        ({"colour": 1}, "colour: unknown key"),
        ({"stimuli": []}, "at least 1 item"),
        ({"title": ""}, "title"),
        ({"display": {"width_mm": -1.0}}, "greater than 0"),
        ({"display": {"width_mm": float("nan")}}, "display.width_mm"),
    ],
)
def test_designs_that_cannot_be_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        checked(small_table(**change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["../secret.png", "/etc/passwd", "a/b.png", "x.svg", "x.png\n"])
def test_pictures_outside_the_folder_are_refused(name: str) -> None:
    table = small_table(repeats=[])
    table["stimuli"] = [{"id": "a", "pictures": [name]}]
    with pytest.raises(ValueError, match="no name of a picture"):
        checked(table)


def test_a_design_of_ones_own_and_a_comparison_of_pairs(drawn: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text((drawn / "experiment.toml").read_text())
    made = tmp_path / "made"
    said = done("experiment", "init", made, "--design", own, "--pictures", drawn / "stimuli")
    assert said["questions"] == 6 and len(list((made / "stimuli").iterdir())) == 5
    pairs = tmp_path / "pairs"
    pairs.mkdir()
    for name in ("silk-reference", "silk-slices", "silk-gantry"):
        (pairs / f"{name}.png").write_bytes((drawn / "stimuli" / "board-1.png").read_bytes())
    for preset, questions, above in (("pairs-1", 2, None), ("pairs-2", 1, "silk-reference.png")):
        folder = tmp_path / preset
        said = done("experiment", "init", folder, "--preset", preset, "--pictures", pairs)
        assert said["questions"] == questions
        table = tomllib.loads((folder / "experiment.toml").read_text())
        assert table["stimuli"][0].get("reference") == above


def test_bad_commands_are_refused(drawn: Path, tmp_path: Path) -> None:
    new = tmp_path / "new"
    assert "either --preset or --design" in refusal("experiment", "init", new)
    assert "unknown preset 'D'" in refusal("experiment", "init", new, "--preset", "D")
    assert "--pictures" in refusal("experiment", "init", new, "--preset", "pairs-1")
    assert "no experiment.toml" in refusal("experiment", "serve", tmp_path)
    assert "no answers yet" in refusal(
        "experiment", "export", _copied(drawn, new), "-o", tmp_path / "o"
    )
    assert "is an origin" in refusal("experiment", "serve", new, "--public", "http://lab.example")
    assert "is no URL" in refusal("experiment", "serve", new, "--database", "nonsense")
    broken = tmp_path / "broken.toml"
    broken.write_text("title = [")
    assert "is no TOML" in refusal("experiment", "init", tmp_path / "b", "--design", broken)
    listener = socket.create_server(("127.0.0.1", 0))
    with listener:
        port = listener.getsockname()[1]
        assert "cannot listen" in refusal("experiment", "serve", new, "--port", str(port))


def _copied(drawn: Path, to: Path) -> Path:
    small_experiment(to, 270)
    return to


def test_answers_to_other_questions_are_not_mixed(tmp_path: Path) -> None:
    folder = tmp_path / "one"
    small_experiment(folder, 270)
    served(folder).stop()
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(
        text.replace('repeats = [\n    "board-3",\n]', "repeats = []")
    )
    assert "other questions" in refusal("experiment", "serve", folder)
