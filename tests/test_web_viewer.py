"""The viewer: the pictures are those of the renderer; nobody reads it without the token."""

from __future__ import annotations

import json
import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browsers import chromium, page_of
from command_line import done, refusal
from simrig.btf.synthetic import chessboard
from simrig.core import backend
from simrig.front_door.materials import as_brdf
from simrig.front_door.viewing import shown_of
from simrig.plugins import make_bsdf, make_btf
from simrig.rendering.render import render
from simrig.scenes import build_scene
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS
from simrig.web.viewer.shading import FORMS, form, in_plane, lit, views_deg
from web_folders import Process


@pytest.fixture(scope="module")
def server() -> Iterator[Process]:
    running = Process("view", "yellow_satin", "purple_satin")
    yield running
    running.stop()


def token_of(server: Process) -> str:
    return server.address.partition("#token=")[2]


@pytest.mark.parametrize("name", ["yellow_satin", "brushed_aluminium"])
@pytest.mark.parametrize("light", [(40.0, 60.0), (0.0, 0.0), (85.0, 200.0)])
def test_the_sphere_is_what_the_renderer_shows(name: str, light: tuple[float, float]) -> None:
    backend.select()
    brdf = as_brdf(name)
    options = {"light_theta_deg": light[0], "light_phi_deg": light[1], "pixel_centres": True}
    scene = build_scene("sphere", make_bsdf(brdf), resolution=128, **options)
    theirs = render(scene, 1).image
    ours = lit(brdf, "sphere", 128, *light)
    assert np.abs(ours - theirs).max() <= 2e-6 * theirs.max()


def test_a_cylinder_is_what_the_renderer_shows() -> None:
    backend.select()
    brdf = as_brdf("yellow_satin")
    scene = build_scene(
        "cylinder", make_bsdf(brdf), light="right", resolution=96, pixel_centres=True
    )
    theirs = render(scene, 1).image
    ours = lit(brdf, "cylinder", 96, 45.0, 0.0)
    factor = theirs.sum() / ours.sum()  # its lamp is set for another nearest point
    assert np.abs(factor * ours - theirs).max() <= 1e-3 * theirs.max()


@pytest.mark.parametrize("zoom", [1.0, 0.25])
def test_a_btf_is_what_the_renderer_shows_at_any_distance(zoom: float) -> None:
    backend.select()
    (shown,) = shown_of((chessboard(5.0),))
    pixel_mm = form("cylinder", 96, zoom).pixel_mm
    scale = {"scale": 2.0 * np.pi * CYLINDER_RADIUS, "scale_v": CYLINDER_HEIGHT}
    material = make_btf(shown.brdf, **scale, pixel_width=pixel_mm)
    resolution = round(96 * zoom)
    scene = build_scene(
        "cylinder", material, light="right", resolution=resolution, pixel_centres=True
    )
    theirs = render(scene, 1).image
    ours = lit(shown.brdf, "cylinder", 96, 45.0, 0.0, 0.0, zoom)
    rows, columns = ((n - round(n * zoom)) // 2 for n in ours.shape[:2])
    ours = ours[rows : rows + 2 * resolution, columns : columns + resolution]
    factor = theirs.sum() / ours.sum()
    assert np.abs(factor * ours - theirs).max() <= 1e-3 * theirs.max()


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_finite_under_any_lamp(form: str) -> None:
    backend.select()
    brdf = as_brdf("yellow_satin")
    for theta in (0.0, 45.0, 90.0, 135.0, 180.0):
        image = lit(brdf, form, 48, theta, 30.0, 45.0)
        assert np.isfinite(image).all() and (image >= 0.0).all()
        assert image.max() > 0.0 or theta >= 90.0


def test_slices_are_the_look_up() -> None:
    brdf = as_brdf("yellow_satin")
    values = in_plane(brdf, 30.0, 0.0, 180.0)
    angle = np.radians(views_deg()[120])
    view = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    light = np.array([0.5, 0.0, np.sqrt(0.75)])
    assert values[120] == pytest.approx(brdf.eval(light, view))


def test_pictures_come_as_halves_with_their_difference(server: Process) -> None:
    status, said, _ = server.ask("POST", "/api/picture", {"resolution": 64}, token_of(server))
    assert status == 200
    (length,) = struct.unpack_from("<I", said)
    head = json.loads(said[4 : 4 + length])
    assert (head["width"], head["height"], head["count"]) == (64, 64, 2)
    pixels = np.frombuffer(said, "<f2", offset=4 + length).reshape(2, 64, 64, 3)
    wanted = lit(as_brdf("yellow_satin"), "sphere", 64)
    assert pixels[0].astype(np.float64) == pytest.approx(wanted, rel=2e-3, abs=1e-6)
    assert head["delta_e"][0] > 0.1


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/api/materials"),
        ("POST", "/api/picture"),
        ("POST", "/api/slices"),
        ("GET", "/api/figure/0"),
        ("POST", "/api/page"),
        ("POST", "/api/command"),
    ],
)
def test_nothing_is_shown_without_the_token(server: Process, method: str, path: str) -> None:
    body = {} if method == "POST" else None
    own = token_of(server)
    for token in (None, "", own + "x", own[:-1], "x" * 3000):
        assert server.ask(method, path, body, token)[0] == 401
    assert server.ask(method, path, body, own, Origin="https://evil.example")[0] == 403
    assert server.ask(method, path, body, own, Host="evil.example")[0] == 421


@pytest.mark.parametrize(
    "change",
    [
        {"resolution": 100_000},
        {"resolution": 0},
        {"theta": "NaN"},
        {"form": "../../etc/passwd"},
        {"exposure": -1},
        {"path": "/etc/passwd"},
        {"theta_i": 90},
        {"zoom": 0},
    ],
)
def test_states_that_cannot_be_are_refused(server: Process, change: dict[str, Any]) -> None:
    status, said, _ = server.ask("POST", "/api/picture", change, token_of(server))
    assert status == 422 and "\n" not in said["error"]


def test_no_path_leads_to_a_file(server: Process) -> None:
    for path in ("/api/figure/9", "/api/figure/-1", "/../page.py", "/%2e%2e/server.py", "/docs"):
        assert server.ask("GET", path, token=token_of(server))[0] in (404, 422)


@pytest.mark.slow
def test_a_page_needs_no_server_and_says_how_it_was_made(tmp_path: Path) -> None:
    page = tmp_path / "view.html"
    done("view", "yellow_satin", "purple_satin", "--export", page, "--light", "30,90")
    text = page.read_text()
    assert all(where.startswith("data:") for where in re.findall(r'(?:src|href)="([^"]*)"', text))
    assert text.count("data:image/png;base64,") == 5  # two, a difference, two of subspaces
    assert "simrig view yellow_satin purple_satin" in text and "--light 30,90" in text
    assert "exists" in refusal("view", "yellow_satin", "--export", page)


def test_bad_commands_are_refused(tmp_path: Path) -> None:
    page = tmp_path / "view.html"
    assert "unknown material" in refusal("view", "nothing", "--export", page)
    assert "one to eight" in refusal("view", *["yellow_satin"] * 9, "--export", page)
    assert "two angles" in refusal("view", "yellow_satin", "--export", page, "--light", "up")
    assert "form" in refusal("view", "yellow_satin", "--export", page, "--form", "cube")
    assert "only a page" in refusal("view", "yellow_satin", "--light", "1,2")
    assert not page.exists()


@pytest.mark.slow
@pytest.mark.parametrize(("size", "ratio"), [((1366, 768), 1.0), ((1920, 1080), 2.0)])
def test_the_lamp_follows_mouse_and_keys(
    server: Process, size: tuple[int, int], ratio: float
) -> None:
    with chromium() as browser, page_of(browser, size, ratio) as (page, faults):
        page.goto(server.address)
        page.wait_for_function("() => window.viewerTimes.length > 1")
        picture = page.locator("canvas.light").first
        seen = "c => c.toDataURL()"
        box = picture.bounding_box()
        page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 0.5 * box["height"], steps=12)
        page.mouse.up()
        page.wait_for_function("() => document.querySelector('canvas.light').width === 256")
        before = picture.evaluate(seen)
        picture.focus()
        for _ in range(6):
            page.keyboard.press("ArrowDown")
        page.wait_for_timeout(400)
        assert picture.evaluate(seen) != before
        page.click("#subspaces")
        page.wait_for_function("() => document.querySelectorAll('#figures img').length === 2")
        page.wait_for_timeout(300)
        folder = os.environ.get("SIMRIG_SCREENSHOTS")
        if folder:
            page.screenshot(path=f"{folder}/viewer-{size[0]}.png", full_page=True)
            print("ms", page.evaluate("() => window.viewerTimes"))
        with page.expect_download() as download:
            page.click("#png")
        assert Path(download.value.path()).read_bytes().startswith(b"\x89PNG")
        page.click("#command")
        page.wait_for_selector("text=simrig view yellow_satin purple_satin --form sphere")
        assert faults == []
        assert page.context.cookies() == []
