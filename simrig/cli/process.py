"""``simrig process``: each stage from recorded pictures to values, on a user's own photographs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite, Scheduler, Workers, numbers, sides, spread_over
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError, check_known
from simrig.core.options import numbers_of

if TYPE_CHECKING:
    import numpy as np

_Pictures = Annotated[list[Path], typer.Argument(help=".npy, .npz, .exr, .tif, .png, ...")]
_Picture = Annotated[Path, typer.Argument(help=".npy, .npz, .exr, .tif, .png, ...")]
_Output = Annotated[Path, typer.Option(help="Ends in .npz, .npy, .exr or .tif.")]
_Pattern = Annotated[str | None, typer.Option(help="Colour filters: RGGB, BGGR, GRBG, GBRG.")]
_Dark = Annotated[Path | None, typer.Option(help="A picture without light.")]
_CLIPPED = 1e-3  # share of a frame's pixels that are as bright as can be
_Corners = Annotated[
    str | None, typer.Option(help="Pixels, clockwise from the top left: '10,12 500,14 ...'.")
]


def merge(
    files: _Pictures,
    output: _Output,
    exposures: Annotated[str, typer.Option(help="Seconds times light level: 1,0.25,0.06.")],
    gain: Annotated[float, typer.Option(help="K, DN per electron.")] = 1.0,
    black: Annotated[float, typer.Option(help="Level without light, DN.")] = 0.0,
    read_noise: Annotated[float, typer.Option(help="Dark noise, electrons.")] = 0.0,
    saturation: Annotated[
        float | None, typer.Option(help="DN; 255 or 65535 of 8 or 16 bits.")
    ] = None,
    dark: _Dark = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Merge raw exposures as precisely as can be; .npz holds value, uncertainty and saturated."""

    from simrig.imaging.merging import SensorModel
    from simrig.imaging.merging import merge as merged

    frames = [_read(file) for file in files]
    stack: Any = frames[0] if len(frames) == 1 and frames[0].ndim == 3 else frames
    times = numbers_of(exposures, "exposure times", float)
    clips = _full_scale(frames) if saturation is None else saturation
    sensor = SensorModel(gain, black, read_noise, clips)
    level = None if dark is None else _read(dark)
    with output_file(output, overwrite):
        made = merged(stack, times, sensor, black=level)
        _write(output, value=made.value, uncertainty=made.uncertainty, saturated=made.saturated)
    share = float(made.saturated.mean())
    notes = []
    if share:
        notes.append(f"{100.0 * share:.2g} % of the pixels are clipped in every frame")
    top = max(frame.max() for frame in frames)
    alike = max(float((frame == top).mean()) for frame in frames)
    if saturation is None and top < clips and alike > _CLIPPED:
        notes.append(f"{100.0 * alike:.2g} % of a frame are {top}: if it clips there, --saturation")
    if made.disagreeing > 1e-4:
        notes.append(
            f"{100.0 * made.disagreeing:.2g} % of the pixels have frames that contradict each "
            "other: movement, or other numbers than those of this sensor"
        )
    about = {"frames": len(times), "saturated": share, "disagreeing": made.disagreeing}
    return _report(output, made.value, about, notes)


def _full_scale(frames: list[np.ndarray]) -> float:
    """Return the largest number of frames of one type.

    Raises:
        SimrigError: frames of several types, or of one that has no largest number.
    """
    types = sorted({str(frame.dtype) for frame in frames})
    known = {"uint8": 255.0, "uint16": 65535.0}
    if len(types) > 1 and set(types) & set(known):
        raise SimrigError(
            f"the frames are {' and '.join(types)}, but one sensor gives one type: scale them to "
            "the same, and say --saturation"
        )
    if types[0] not in known:
        raise SimrigError(f"frames of {types[0]} do not say where they clip: give --saturation")
    return known[types[0]]


def defects(
    file: _Picture,
    output: _Output,
    dark: Annotated[Path, typer.Option(help="A picture without light.")],
    white: Annotated[Path, typer.Option(help="A picture of a white sheet.")],
    pattern: _Pattern = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Find defective pixels by a dark and a white picture, and fill them."""
    from simrig.imaging.mosaic import fill_defects, find_defects

    bad = find_defects(_read(dark), _read(white), pattern)
    with output_file(output, overwrite):
        made = fill_defects(_read(file), bad, pattern)
        _write(output, value=made, defects=bad)
    return _report(output, made, {"defects": int(bad.sum())}, [f"{int(bad.sum())} defects"])


def flat(
    file: _Picture,
    output: _Output,
    white: Annotated[Path, typer.Option(help="A picture of a white sheet.")],
    pattern: _Pattern = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Divide by the flat field of a white sheet; both merged, or linear and without black level."""
    from simrig.imaging.flat import flat_field, flattened

    field = flat_field(_read(white), pattern)
    with output_file(output, overwrite):
        made = flattened(_read(file), field)
        _write(output, value=made, flat=field)
    spread = float(field.max() / field.min())
    return _report(output, made, {"range": spread}, [f"the flat field spans 1 : {spread:.3g}"])


def illumination(
    readings: Annotated[Path, typer.Argument(help="Lines of x, y, reading (.csv or .npy).")],
    degree: Annotated[int, typer.Option(help="Of the polynomial in x and y.")] = 2,
) -> frame.Report:
    """Fit a polynomial to readings of the light over the sample (thesis section 4.1)."""
    import numpy as np

    from simrig.imaging.flat import Illumination

    if readings.suffix.lower() == ".npy":
        table = _read(readings)
    else:
        try:
            table = np.loadtxt(readings, delimiter=",", comments="#", ndmin=2)
        except (OSError, ValueError) as error:
            raise SimrigError(f"'{readings}' holds no lines of x, y, reading: {error}") from error
    if table.ndim != 2 or table.shape[1] != 3:
        raise SimrigError(f"'{readings}' must hold three columns x, y, reading, got {table.shape}")
    found = Illumination.fitted(table[:, 0], table[:, 1], table[:, 2], degree)
    about = {
        "degree": found.degree,
        "coefficients": found.coefficients,
        "centre": found.centre,
        "half": found.half,
        "relative_error": found.error,
    }
    return frame.Report(about, [f"degree {degree}: {100.0 * found.error:.3g} % rms is left"])


def demosaic(
    file: _Picture,
    output: _Output,
    pattern: Annotated[str, typer.Option(help="Colour filters: RGGB, BGGR, GRBG, GBRG.")],
    method: Annotated[str, typer.Option(help="malvar, bilinear, or planes.")] = "malvar",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Make colours of a mosaic; 'planes' averages each 2 × 2 pixels and interpolates nothing."""
    from simrig.imaging.mosaic import demosaic as demosaiced

    with output_file(output, overwrite):
        made = demosaiced(_read(file), pattern, method)
        _write(output, value=made)
    return _report(output, made, {"method": method}, [])


def colour(
    file: _Picture,
    output: _Output,
    chart: Annotated[Path, typer.Option(help="A picture of the ColorChecker (24 patches).")],
    corners: Annotated[str, typer.Option(help="Of the chart, from dark skin clockwise.")],
    spectrum: Annotated[
        Path | None, typer.Option(help="Of the light: lines of nm, power. D65 else.")
    ] = None,
    space: Annotated[str, typer.Option(help="srgb (linear, white D65) or xyz.")] = "srgb",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Turn camera colours into linear sRGB or CIE XYZ by a chart under the rig's own light."""
    import numpy as np

    from simrig.imaging.chart import chart_xyz, colour_matrix, read_patches

    check_known("colour space", space, ("srgb", "xyz"))
    light: Any = (None, None)
    if spectrum is not None:
        try:
            light = np.loadtxt(spectrum, delimiter=",", comments="#", ndmin=2)[:, :2].T
        except (OSError, ValueError, IndexError) as error:
            raise SimrigError(f"'{spectrum}' holds no lines of nm, power: {error}") from error
    reference, white = chart_xyz(*light)
    found = colour_matrix(read_patches(_read(chart), _points(corners)), reference, white)
    values = _read(file)
    if values.ndim != 3 or values.shape[2] != 3:
        raise SimrigError(f"'{file}' must have three channels, got {values.shape}: demosaic it")
    with output_file(output, overwrite):
        made = found.srgb(values) if space == "srgb" else found.xyz(values)
        _write(output, value=made, matrix=found.matrix)
    mean, worst = float(found.errors.mean()), float(found.errors.max())
    about = {"matrix": found.matrix, "mean_dE": mean, "largest_dE": worst, "space": space}
    return _report(
        output, made, about, [f"the chart is left with ΔE {mean:.2f}, at most {worst:.2f}"]
    )


def register(
    files: _Pictures,
    output: Annotated[Path, typer.Option(help="The views (.npz), for 'process plane'.")],
    frame_mm: Annotated[str, typer.Option(help="Outer sides of the bright frame: 64x64.")],
    size_mm: Annotated[float, typer.Option(help="Side of the square that is registered.")],
    pitch_mm: Annotated[float, typer.Option(help="Between its pixels.")],
    corners: _Corners = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Find the frame in each picture, calibrate the camera from it, and register the pictures."""
    import numpy as np

    from simrig.imaging.camera import calibrate
    from simrig.imaging.marks import find_frame, frame_corners, search_frame
    from simrig.imaging.registration import Area, registered_views

    width, height = sides(frame_mm, "--frame-mm are two sizes above 0 such as 64x64")
    marks = frame_corners(width, height)
    pictures = [_grey(_read(file, shapes_only=True)) for file in files]
    given = None if corners is None else _points(corners)
    found = []
    for file, picture in zip(files, pictures, strict=True):
        try:
            expected = search_frame(picture) if given is None else given
            found.append(find_frame(picture, expected))
        except SimrigError as error:
            raise SimrigError(f"'{file}': {error}") from error
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        raise SimrigError("the pictures differ in size: they must be of one camera")
    size = pictures[0].shape[::-1]
    cameras, off = calibrate(marks, [m.pixels for m in found], (size[0], size[1]))
    with output_file(output, overwrite), frame.progress("registering") as report:
        views = registered_views(pictures, cameras, Area.of_pitch(size_mm, pitch_mm), report)
        _write(
            output,
            value=views.pictures,
            pitch_mm=np.array(views.pitch_mm),
            cameras_mm=views.cameras_mm,
        )
    about = {"views": len(files), "reprojection_px": off, "focal_px": cameras[0].matrix[0, 0]}
    return _report(output, views.pictures, about, [f"marks fit to {off:.3f} pixels"])


def plane(
    views: Annotated[Path, typer.Argument(help="Registered views of 'process register' (.npz).")],
    method: Annotated[str, typer.Option(help="fit (Gauss-Newton) or search (thesis).")] = "fit",
    height_mm: Annotated[float, typer.Option(help="How far off the surface may be.")] = 2.0,
    tilt_deg: Annotated[float, typer.Option(help="How tilted it may be.")] = 3.0,
    components: Annotated[int | None, typer.Option(help="Principal components kept.")] = None,
) -> frame.Report:
    """Find the true plane of the surface, and say what speaks against it."""
    from simrig.files.values import read_values
    from simrig.imaging.alignment import Views
    from simrig.imaging.plane import fit_plane, search_plane

    check_known("method", method, ("fit", "search"))
    names = ("value", "pitch_mm", "cameras_mm")
    pictures, pitch, cameras = (read_values(views, name) for name in names)
    if pitch.size != 1:
        raise SimrigError(f"'{views}' is none of 'process register': its pitch is no number")
    find = fit_plane if method == "fit" else search_plane
    found = find(
        Views(pictures, float(pitch), cameras),
        height_mm=height_mm,
        tilt_deg=tilt_deg,
        components=components,
    )
    about = found.as_dict()
    shown = [
        f"z = {found.plane.z_mm:.4f} ± {found.u_z_mm:.4f} mm, tilt {about['theta_deg']:.3f}° at "
        f"{about['phi_deg']:.1f}° ± {about['u_tilt_deg']:.3f}° (k = 1)",
        f"PCA error {found.error_before:.3f} → {found.error_after:.3f}, {found.evaluations} "
        f"evaluations, {found.seconds:.1f} s",
    ]
    return frame.Report(about, [*shown, *(f"doubt: {doubt}" for doubt in found.doubts)])


def tile(
    file: Annotated[Path, typer.Argument(help="A BTF (.h5) of a surface that does not repeat.")],
    output: Annotated[Path, typer.Argument(help="The BTF that repeats (.h5).")],
    size: Annotated[str, typer.Option(help="Width and height of the tile in texels: 96x96.")],
    overwrite: Overwrite = False,
) -> frame.Report:
    """Cut a tile that repeats along the path of least difference, the same in all images."""
    from simrig.rigs.imaging.tiles import write_tiled

    width, height = sides(size, "--size are two numbers of texels such as 96x96")
    if width != int(width) or height != int(height):
        raise SimrigError(f"--size must be whole texels, got {size}")
    with output_file(output, overwrite), frame.progress(f"cutting {output.name}") as report:
        tiling = write_tiled(output, file, int(height), int(width), report)
    about = {"seam": tiling.seam, "plain_seam": tiling.plain_seam}
    shown = (
        f"{output}: a step across the seam is {tiling.seam:.2f} times one within the tile, "
        f"{tiling.plain_seam:.2f} times if cut straight"
    )
    return frame.Report({"output": output, **about}, [shown])


def recording(
    folder: Annotated[Path, typer.Argument(help="A recording of 'simrig record'.")],
    output: Annotated[Path, typer.Option(help="The BTF (.h5), as simrig_btf renders it.")],
    pixels: Annotated[int, typer.Option(min=8, help="Of the images, a side.")] = 128,
    size_mm: Annotated[float | None, typer.Option(help="Side shown; the sample else.")] = None,
    plane: Annotated[str, typer.Option(help="fit, or marks: the frame's own.")] = "fit",
    method: Annotated[str, typer.Option(help="Of demosaicing: malvar or bilinear.")] = "malvar",
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for the registered images (.exr) too.")
    ] = None,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Process a whole recording into a BTF; an interrupted one goes on where it stopped."""
    from simrig.files.checkpoint import checkpoint_of
    from simrig.rigs.imaging.chain import Settings
    from simrig.rigs.imaging.processing import process_recording

    check_known("method", method, ("malvar", "bilinear"))
    spread = spread_over(workers, scheduler)
    settings = Settings(pixels, size_mm, plane, method)
    with output_file(output, overwrite):
        frame.on_interrupt(f"the same command goes on from '{checkpoint_of(output)}'")
        with frame.progress(f"processing {folder.name}") as report:
            found = process_recording(folder, output, settings, pictures, report, spread)
    shown = [f"{output}: {found['poses']:,} images of {pixels} × {pixels} texels"]
    at = found["plane"]
    if "z_mm" in at:
        shown.append(
            f"surface at z = {at['z_mm']:.4f} ± {at['u_z_mm']:.4f} mm, tilt {at['theta_deg']:.3f}° "
            f"± {at['u_tilt_deg']:.3f}° at {at['phi_deg']:.0f}° (k = 1), PCA error "
            f"{at['pca_error_before']:.3f} → {at['pca_error_after']:.3f}"
        )
        shown += [f"doubt: {doubt}" for doubt in at["doubts"]]
    else:
        shown.append(at["taken"])
    shown += found["without"]
    missed = found["poses"] - found["marks_found"]
    if missed:
        shown.append(f"{missed:,} poses are registered by the instrument's word, not by the frame")
    if found["negative_share"] > 0.0:
        shown.append(f"{100 * found['negative_share']:.2g} % of the values were negative: set to 0")
    return frame.Report({"output": output, **found}, shown)


def _read(path: Path, shapes_only: bool = False) -> np.ndarray:
    from simrig.files.values import read_values

    return read_values(path, shapes_only=shapes_only)


def _write(path: Path, **arrays: np.ndarray) -> None:
    from simrig.files.values import write_values

    write_values(path, arrays)


def _grey(values: np.ndarray) -> np.ndarray:
    import numpy as np

    return np.asarray(values.mean(axis=-1) if values.ndim == 3 else values, dtype=np.float64)


def _points(text: str) -> np.ndarray:
    import numpy as np

    return np.array(numbers(text, "--corners are four points 'x,y x,y x,y x,y'", 8)).reshape(4, 2)


def _report(
    output: Path, values: np.ndarray, about: Mapping[str, Any], notes: list[str]
) -> frame.Report:
    shape = " × ".join(str(side) for side in values.shape)
    return frame.Report({"output": output, "shape": values.shape, **about},
                        [f"{output}: {shape}", *notes])  # fmt: skip
