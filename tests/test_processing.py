"""A recording becomes f_r; what is damaged or interrupted loses nothing."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy import ndimage

from command_line import done as run_json
from command_line import refusal as bad_input
from simrig.brdf import Lambert
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.evaluation.stability.recordings import PLANE, SAMPLE_MM, write_recording
from simrig.evaluation.studies.registration.surfaces import SURFACES
from simrig.files.btf.hdf5 import read_btf
from simrig.files.images import read_image
from simrig.files.load import load_material
from simrig.files.recorded import RecordedPictures
from simrig.imaging.alignment import Plane
from simrig.imaging.camera import from_pose
from simrig.imaging.registration import projected, register
from simrig.instruments.description import described, shipped
from simrig.rigs.imaging.chain import Chain, Settings, _parts
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.processing import process_recording
from simrig.rigs.imaging.recorder import Camera, Recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings") / "printout"
    folder.mkdir()
    write_recording(folder)
    return folder


def copied(recording, place):
    import shutil

    shutil.copytree(recording, place)
    return place


@pytest.fixture(scope="module")
def processed(recording, tmp_path_factory):
    output = tmp_path_factory.mktemp("processed") / "out.h5"
    about = process_recording(recording, output, Settings(pixels=160, size_mm=32.0),
                              output.with_suffix(""))  # fmt: skip
    return output, about


def test_values_are_those_of_the_surface(processed):
    """The truth is the albedo that the rays read, at the points where the texels are."""
    output, about = processed
    assert about["marks_found"] == 9
    assert abs(about["plane"]["z_mm"] - PLANE.z_mm) < 0.02
    stack = read_btf(output)
    images = stack.images(np.arange(9)).astype(np.float64)
    surface = SURFACES["printout"](np.random.default_rng(0))
    along = ((np.arange(160) + 0.5) / 160 - 0.5) * 32.0
    texel = ((along / 64.0 * 800) + 399.5).round().astype(int)
    truth = surface.albedo[np.ix_(texel[::-1], texel)] * PLANE.normal[2] / np.pi
    for image in images:
        assert image.mean() == pytest.approx(truth.mean(), rel=0.01)
    flat = images[0, ..., 0]
    assert np.corrcoef(flat.ravel(), truth.ravel())[0, 1] > 0.97
    # plateaus, where neither lens nor pixels smooth anything
    level = ndimage.maximum_filter(truth, 9) - ndimage.minimum_filter(truth, 9) < 1e-3
    assert level.sum() > 500
    for image in images[:6]:
        assert np.mean(image[level, 0] / truth[level]) == pytest.approx(1.0, abs=0.005)
    assert stack.size_mm == (32.0, 32.0)


def test_registered_pictures_carry_their_pose(processed):
    output, about = processed
    pictures = sorted(output.with_suffix("").glob("*.exr"))
    assert len(pictures) == about["poses"]
    stack = read_btf(output)
    shown = np.maximum(read_image(pictures[3]), 0.0)
    assert np.allclose(shown, stack.images(np.array([3]))[0], atol=2e-4)
    import OpenEXR

    with OpenEXR.File(str(pictures[3]), separate_channels=True) as file:
        header = file.header()
        assert header["theta_v_deg"] == pytest.approx(np.degrees(stack.angles[3, 1]), abs=1e-4)
        assert {"R", "G", "B", "xyz.X", "xyz.Y", "xyz.Z"} == set(file.channels())


@pytest.mark.slow
def test_a_killed_processing_ends_in_the_same_bits(recording, processed, tmp_path):
    output = tmp_path / "out.h5"
    own = ["process", "recording", str(recording), "-o", str(output), "--pixels", "160"]
    own = [sys.executable, "-m", "simrig.cli", *own, "--size-mm", "32", "--quiet"]
    with subprocess.Popen(own, stderr=subprocess.PIPE) as first:
        pieces = tmp_path / ".out.h5.checkpoint"
        while first.poll() is None and len(list(pieces.glob("*.npz"))) < 3:
            time.sleep(0.01)
        first.send_signal(signal.SIGKILL)
    assert not output.exists()
    subprocess.run(own, check=True, capture_output=True)
    whole, again = read_btf(processed[0]), read_btf(output)
    assert np.array_equal(whole.values[:], again.values[:])
    assert {path.name for path in tmp_path.iterdir()} == {"out.h5"}


def test_calibration_pictures_that_are_not_there_are_named(recording, tmp_path):
    folder = copied(recording, tmp_path / "recording")
    before = Chain(RecordedPictures(folder), Settings(pixels=16)).without
    kept = sorted(path.stem for path in (folder / "calibration").glob("*.npz"))
    for path in (folder / "calibration").glob("*.npz"):
        path.unlink()
    after = Chain(RecordedPictures(folder), Settings(pixels=16)).without
    assert len(after) == len(before) + len(kept) and len(kept) > 0
    assert all(f"no calibration/{name}.npz" in " ".join(after) for name in kept)


def test_what_is_damaged_is_named_and_nothing_is_lost(recording, tmp_path):
    folder = copied(recording, tmp_path / "recording")
    whole = (folder / "poses" / "000005.npz").read_bytes()
    (folder / "poses" / "000005.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SimrigError, match=r"000005.npz' is damaged"):
        process_recording(folder, tmp_path / "out.h5", Settings(pixels=16))
    damaged = bytearray(whole)
    damaged[5000] ^= 0xFF
    (folder / "poses" / "000005.npz").write_bytes(damaged)
    error = bad_input("process", "recording", folder, "-o", tmp_path / "out.h5", "--pixels", 16)
    assert "000005.npz' is damaged" in error
    (folder / "poses" / "000005.npz").unlink()
    with pytest.raises(SimrigError, match="8 of 9 poses"):
        process_recording(folder, tmp_path / "out.h5", Settings(pixels=16))
    (folder / "recording.json").write_text("{")
    with pytest.raises(SimrigError, match="damaged"):
        process_recording(folder, tmp_path / "out.h5", Settings(pixels=16))
    with pytest.raises(SimrigError, match="no recording"):
        process_recording(tmp_path, tmp_path / "out.h5")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sample": {}}, "size_mm of the recording's sample must be a number, got None"),
        ({"sample": {"size_mm": -1.0}}, "above 0"),
        ({"sample": {"size_mm": 40.0, "marks_mm": [[1.0], [2.0, 3.0]]}}, "marks_mm"),
        ({"sample": {"size_mm": 40.0, "marks_mm": [[1.0, 2.0, 0.0]]}}, r"must be \(4, 3\)"),
        ({"effects": "all"}, "are objects"),
        ({"poses": -1}, "whole number above 0, got -1"),
        ({"poses": "x"}, "whole number above 0, got 'x'"),
        ({"poses": float("nan")}, "whole number above 0, got nan"),
        ({"poses": 8}, "9 poses where recording.json says 8"),
        ({"calibration": {"white_albedo": "white"}}, "white_albedo of the recording"),
    ],
)
def test_what_a_recording_says_is_checked(recording, tmp_path, change, said):
    folder = copied(recording, tmp_path / "recording")
    about = json.loads((folder / "recording.json").read_text()) | change
    (folder / "recording.json").write_text(json.dumps(about))
    with pytest.raises(SimrigError, match=said):
        process_recording(folder, tmp_path / "out.h5", Settings(pixels=16, plane="marks"))


def test_a_picture_of_other_shapes_is_named(recording, tmp_path):
    folder = copied(recording, tmp_path / "recording")
    with np.load(folder / "poses" / "000002.npz") as file:
        arrays = dict(file)
    np.savez(folder / "poses" / "000002.npz", **arrays | {"angles": np.zeros(3)})
    with pytest.raises(SimrigError, match=r"000002.npz': angles must be \(4,\) finite numbers"):
        process_recording(folder, tmp_path / "out.h5", Settings(pixels=16))


def test_info_knows_a_recording_and_what_to_do_next(recording, tmp_path):
    folder = copied(recording, tmp_path / "recording")
    about = run_json("info", folder)
    assert about["kind"] == "recording" and about["facts"]["poses"] == "9 of 9"
    assert about["facts"]["calibration"] == ["white"] and about["says"]["bits"] == 14
    assert about["use"] == [f"simrig process recording {folder} --output NAME.h5"]
    (folder / "poses" / "000008.npz").unlink()
    assert "8 of 9 poses: finish recording first" in run_json("info", folder)["use"][0]


def test_no_room_and_no_folder_are_one_line(recording, tmp_path):
    error = bad_input("process", "recording", recording, "-o", tmp_path / "no" / "out.h5")
    assert "does not exist" in error
    about = json.loads((recording / "recording.json").read_text())
    assert about["sample"]["size_mm"] == SAMPLE_MM
    for size, said in (
        (41, "asked for are 41 mm: lower --size-mm"),
        (-1, "above 0"),
        ("nan", "finite"),
    ):
        error = bad_input("process", "recording", recording, "-o", tmp_path / "out.h5",
                          "--size-mm", size)  # fmt: skip
        assert said in error
    assert not any(tmp_path.iterdir())


def test_a_full_disk_loses_nothing(recording, tmp_path):
    """Files of more than 4 kB are refused by the system, as on a disk that is full."""
    output = tmp_path / "out.h5"
    own = ["process", "recording", str(recording), "-o", str(output), "--pixels", "64", "--quiet"]
    own = [sys.executable, "-m", "simrig.cli", *own, "--plane", "marks"]
    limited = ["bash", "-c", 'ulimit -f 4; exec "$@"', "bash", *own]
    full = subprocess.run(limited, capture_output=True, text=True)
    assert full.returncode == 2 and full.stderr.count("\n") == 1, full.stderr
    assert "no room is left" in full.stderr and not output.exists()
    subprocess.run(own, check=True, capture_output=True)
    assert len(read_btf(output)) == 9


@pytest.mark.slow
def test_what_simrig_records_comes_back(tmp_path):
    """Recorded by the rig's own code, which shares nothing with the processing but the contract."""
    pairs = [(5.0, 0.0, 0.0, 0.0), (45.0, 30.0, 90.0, 40.0), (20.0, 70.0, 0.0, 200.0)]
    lines = "\n".join(",".join(map(str, pair)) for pair in pairs)
    (tmp_path / "pairs.txt").write_text(lines + "\n")
    run_json("record", "fabric112", "--plan", "directions", "--pairs", tmp_path / "pairs.txt",
             "--sample-mm", 4, "--everything", "-o", tmp_path / "recording")  # fmt: skip
    about = run_json("process", "recording", tmp_path / "recording", "-o", tmp_path / "out.h5",
                     "--pixels", 24)  # fmt: skip
    assert about["marks_found"] == 3 and "plane of the marks" in about["plane"]["taken"]
    assert about["without"] == []
    stack, truth = read_btf(tmp_path / "out.h5"), load_material("fabric112")
    centre = stack.images(np.arange(3)).astype(np.float64)[:, 8:16, 8:16].mean(axis=(1, 2))
    assert np.allclose(centre, truth.eval(*stack.directions), rtol=0.01)


def test_stages_work_on_files(tmp_path):
    rng = np.random.default_rng(0)
    import cv2

    for name, time_s in (("a", 1.0), ("b", 0.25)):
        frame = np.rint(200 + 0.5 * rng.poisson(8000 * time_s, (12, 14))).astype(np.uint16)
        cv2.imwrite(str(tmp_path / f"{name}.png"), frame)
    made = run_json(
        "process", "merge", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "m.npz",
        "--exposures", "1,0.25", "--gain", 0.5, "--black", 200, "--read-noise", 2,
    )  # fmt: skip
    assert made["saturated"] == 0.0 and made["shape"] == [12, 14]
    value = np.load(tmp_path / "m.npz")["value"]
    assert value.mean() == pytest.approx(8000.0, rel=0.005)
    np.save(tmp_path / "w.npy", np.full((12, 14), 100.0))
    run_json("process", "flat", tmp_path / "m.npz", "-o", tmp_path / "f.tif", "--white",
             tmp_path / "w.npy")  # fmt: skip
    run_json("process", "demosaic", tmp_path / "f.tif", "-o", tmp_path / "d.exr", "--pattern",
             "RGGB", "--method", "planes")  # fmt: skip
    assert read_image(tmp_path / "d.exr").shape == (6, 7, 3)
    assert "as many exposures" in bad_input(
        "process", "merge", tmp_path / "a.png", "-o", tmp_path / "x.npz", "--exposures", "1,2"
    )
    (tmp_path / "m.gif").write_bytes(b"GIF8")
    assert "ends in none of" in bad_input(
        "process", "flat", tmp_path / "m.gif", "-o", tmp_path / "x.npz", "--white",
        tmp_path / "w.npy",
    )  # fmt: skip
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY")
    assert "damaged" in bad_input(
        "process", "demosaic", tmp_path / "bad.npy", "-o", tmp_path / "x.npz", "--pattern", "RGGB"
    )
    assert not (tmp_path / "x.npz").exists()


def test_a_jpeg_tells_shapes_but_no_light(tmp_path):
    """A frame turned in the picture's plane only: found in the JPEG, too little for a camera."""
    import cv2

    picture = np.full((200, 240), 20, np.uint8)
    cv2.rectangle(picture, (40, 30), (200, 170), 230, -1)
    cv2.rectangle(picture, (60, 50), (180, 150), 60, -1)
    views = [tmp_path / f"{name}.jpg" for name in "abc"]
    for view, degrees in zip(views, (0.0, 5.0, 10.0), strict=True):
        turn = cv2.getRotationMatrix2D((120.0, 100.0), degrees, 1.0)
        cv2.imwrite(str(view), cv2.warpAffine(picture, turn, (240, 200), borderValue=20))
    sizes = ("--frame-mm", "64x56", "--size-mm", 30, "--pitch-mm", 1)
    said = bad_input("process", "register", *views, *sizes, "-o", tmp_path / "v.npz")
    assert "different directions" in said
    assert "made for a display" in bad_input(
        "process", "flat", views[0], "--white", views[1], "-o", tmp_path / "x.npz"
    )


@pytest.mark.slow
def test_more_processes_give_the_same_bits(recording, processed, tmp_path):
    output = tmp_path / "out.h5"
    own = ("process", "recording", recording, "-o", output, "--pixels", 160, "--size-mm", 32)
    run_json(*own, "--workers", 2)
    assert np.array_equal(read_btf(processed[0]).values[:], read_btf(output).values[:])
    assert "leave out --workers" in bad_input(*own, "--workers", 2, "--scheduler", "tcp://no:1")


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    """Six pictures from one place, with the errors of axes, noise, a bent lens and a mosaic."""
    description = described(shipped("utia").model_dump(mode="json", exclude_none=True))
    angles = np.radians([[theta, 55.0, 20.0 * theta, 90.0] for theta in range(5, 65, 10)])
    effects = ("positioning", "fall-off", "distortion", "photon-noise", "dark-noise",
               "quantisation")  # fmt: skip
    camera = Camera(Optics.of(description, 10.0), Lambert((0.5, 0.3, 0.1)), effects)
    folder = tmp_path_factory.mktemp("views") / "recording"
    Recording(camera, angles, "a view", {}).run(folder)
    return folder


def chain_of(folder):
    return Chain(RecordedPictures(folder), Settings(pixels=24, size_mm=8.0, plane="marks"))


def test_pictures_from_one_place_share_the_camera_that_their_frame_tells(view):
    chain = chain_of(view)
    for number, image, marked in chain.images(range(6), [0, 2, 4], Plane()):
        ((_, alone, _),) = chain.images([number], [number], Plane())
        assert marked
        np.testing.assert_allclose(image.mean(axis=(0, 1)), alone.mean(axis=(0, 1)), rtol=1e-4)


def test_where_something_moved_every_picture_has_a_camera_of_its_own(view, tmp_path):
    """The frame of one of three pictures is two pixels beside that of the others."""
    folder = copied(view, tmp_path / "recording")
    with np.load(folder / "poses" / "000002.npz") as file:
        arrays = {name: file[name] for name in file.files if not name.endswith(".json")}
    moved = arrays | {"frames": np.roll(arrays["frames"], 2, axis=2)}
    np.savez(folder / "poses" / "000002.npz", **moved)
    chain = chain_of(folder)
    for number, image, marked in chain.images(range(6), [0, 2, 4], Plane()):
        ((_, alone, _),) = chain.images([number], [number], Plane())
        assert marked and np.array_equal(image, alone)


def test_a_window_holds_all_that_an_image_needs(view):
    """The same image from the whole picture, by ``register`` of its colours, in parts of texels."""
    chain = chain_of(view)
    ((_, image, _),) = chain.images([3], [3], Plane())
    taken = chain.recording.pose(3)
    nominal = from_pose(taken["intrinsics"], taken["distortion"], taken["camera_to_world"])
    camera = nominal.posed(chain.corners, chain.marks(taken))
    columns, rows = chain.area.pixels
    parts = _parts(projected(camera, chain.area)[0])
    whole, seen = register(
        chain.colours(taken),
        camera,
        chain.area.divided(parts, chain.area.size_mm[0] / columns / parts),
    )
    whole = whole.reshape(rows, parts, columns, parts, 3).mean(axis=(1, 3))
    light = chain.irradiance(*chain.area.points(), Plane(), taken["light_mm"])
    whole = whole / light[..., None] @ (FROM_XYZ @ chain.colour.matrix).T
    assert seen.all()
    np.testing.assert_allclose(image, whole, rtol=1e-7, atol=1e-9)
