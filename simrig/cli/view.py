"""``simrig view``: materials side by side in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite, check_exposure, numbers
from simrig.cli.outputs import output_file


def view(
    materials: Annotated[
        list[str], typer.Argument(help="BRDFs and BTFs: names or files, up to eight.")
    ],
    measurement: Annotated[
        Path | None, typer.Option(help="Whose sample positions the pictures of subspaces show.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 0,
    export: Annotated[
        Path | None, typer.Option(help="Write one HTML page that needs no server, and end.")
    ] = None,
    form: Annotated[
        str, typer.Option(help="Of the page: sphere, cylinder, plane, four_spheres.")
    ] = "sphere",
    light: Annotated[str, typer.Option(help="Of the page: polar angle and azimuth.")] = "40,60",
    rotation: Annotated[float, typer.Option(help="Of the page: degrees about the normal.")] = 0.0,
    zoom: Annotated[
        float, typer.Option(help="Of the page: magnification; below 1 from further away.")
    ] = 1.0,
    exposure: Annotated[
        float | None, typer.Option(help="Of the page: factor; the brightest becomes white else.")
    ] = None,
    slice_: Annotated[
        str, typer.Option("--slice", help="Of the page: illumination's angles, views' azimuth.")
    ] = "30,0,180",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Show materials side by side in the browser; the first line printed is the address.

    Only this machine reaches it, only with the token at the end of the address, and it shows
    nothing but the materials that are named here.
    """
    from simrig.front_door.materials import load_measurement
    from simrig.front_door.viewing import shown_of

    recorded = None if measurement is None else load_measurement(measurement)
    shown = shown_of(materials, recorded)
    names = ", ".join(s.name for s in shown)
    if export is None:
        from simrig.web.viewer.opening import Viewer

        frame.refuse_unused(
            "only a page takes it",
            *("form", "light", "rotation", "zoom", "exposure", "slice_", "overwrite"),
        )
        viewer = Viewer(shown, port)
        lines = [viewer.address, f"shows {names}; only this machine can reach it; Ctrl-C ends"]
        return frame.Report({"address": viewer.address}, lines, then=viewer.serve)
    from simrig.core import backend
    from simrig.web.viewer.exporting import write_page

    frame.refuse_unused("a page needs no server", "port")
    check_exposure(exposure)
    theta, phi = numbers(light, "--light takes two angles, as 40,60", 2)
    theta_i, phi_i, phi_v = numbers(slice_, "--slice takes three angles, as 30,0,180", 3)
    state = {
        "form": form,
        "theta": theta,
        "phi": phi,
        "rotation": rotation,
        "zoom": zoom,
        "theta_i": theta_i,
        "phi_i": phi_i,
        "phi_v": phi_v,
    }
    with output_file(export, overwrite):
        backend.select()
        write_page(shown, state, exposure, export)
    return frame.Report({"output": export}, [f"{export}: {names}"])
