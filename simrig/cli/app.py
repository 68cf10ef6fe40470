"""The application: every command under its name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from simrig import __version__
from simrig.cli import (
    ablate,
    audit,
    bake,
    budget,
    compare,
    converge,
    convert,
    database,
    distance,
    doctor,
    experiment,
    film,
    frame,
    info,
    instrument,
    materials,
    measure,
    pareto,
    plan,
    process,
    reconstruct,
    record,
    reflector,
    render,
    stability,
    stimuli,
    studies,
    view,
    web_experiment,
)
from simrig.cli.btf import files as btf_files
from simrig.cli.btf import measure as btf
from simrig.cli.btf import varying as btf_varying
from simrig.cli.declared import declaring

Commands = dict[str, Callable[..., frame.Report]]

app = typer.Typer(
    name="simrig", cls=frame.OneLineErrors, add_completion=False, pretty_exceptions_enable=False
)


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """A virtual laboratory for measuring how materials look."""
    if version:
        print(f"simrig {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


_COMMANDS: Commands = {
    "doctor": doctor.doctor,
    "demo": experiment.demo,
    "run": experiment.run,
    "materials": materials.materials,
    "measure": measure.measure,
    "record": record.record,
    "reconstruct": reconstruct.reconstruct,
    "plan": plan.plan,
    "render": render.render,
    "view": view.view,
    "compare": compare.compare,
    "convert": convert.convert,
    "bake": bake.bake,
    "info": info.info,
    "instrument": instrument.instrument,
    "converge": converge.converge,
    "ablate": ablate.ablate,
    "audit": audit.audit,
    "distance": distance.distance,
    "distance-map": distance.distance_map,
    "pareto": pareto.pareto,
    "budget": budget.budget,
    "bench": studies.bench,
    "stability": stability.stability,
}
_STUDY: Commands = {
    "list": studies.list_studies,
    "run": studies.run_study,
    "report": studies.report_study,
}
_BTF: Commands = {
    "measure": btf.measure,
    "info": btf_files.info,
    "convert": btf_files.convert,
    "fill": btf_files.fill,
    "factor": btf_files.factor,
    "average": btf_files.average,
    "from-slices": btf_files.from_slices,
    "sequence": btf_varying.sequence,
    "at": btf_varying.at,
    "animate": btf_varying.animate,
}
_DATABASE: Commands = {
    "build": database.build,
    "list": database.list_materials,
    "show": database.show,
    "export": database.export,
}
_REFLECTOR: Commands = {
    "picture": reflector.picture,
    "analyse": reflector.analyse,
    "sheet": reflector.sheet,
    "subspace": reflector.subspace,
}
_STIMULI: Commands = {
    "cylinders": stimuli.cylinders,
    "rotation": stimuli.rotation,
    "chessboard": stimuli.chessboard,
    "room": stimuli.room,
}
_PROCESS: Commands = {
    "merge": process.merge,
    "defects": process.defects,
    "flat": process.flat,
    "illumination": process.illumination,
    "demosaic": process.demosaic,
    "colour": process.colour,
    "register": process.register,
    "plane": process.plane,
    "tile": process.tile,
    "recording": process.recording,
    "gantry": film.gantry,
}
_EXPERIMENT: Commands = {
    "init": web_experiment.init,
    "serve": web_experiment.serve,
    "load": web_experiment.load,
    "export": web_experiment.export,
    "delete": web_experiment.delete,
    "analyse": web_experiment.analyse,
}
_GROUPS: dict[str, tuple[str, Commands]] = {
    "study": ("Published tables and figures beside ours.", _STUDY),
    "btf": ("BTFs: measure, look at, convert, fill, factor, average.", _BTF),
    "database": ("BRDFs known before: the virtual database, or your own.", _DATABASE),
    "reflector": ("An ellipsoidal mirror: anisotropy in one picture, swept subspaces.", _REFLECTOR),
    "experiment": ("Ask people on the web from where on structure cannot be seen.", _EXPERIMENT),
    "process": ("From recorded pictures to values, stage by stage.", _PROCESS),
    "stimuli": ("Scenes of the study of structure: cylinders, frames, room.", _STIMULI),
}
# what plans, rigs and methods declare becomes options of these
_DECLARED = {
    "measure": measure.declarers,
    "record": record.declarers,
    "reconstruct": reconstruct.declarers,
}

for name, function in _COMMANDS.items():
    takes: dict[str, Any] = {"cls": declaring(_DECLARED[name])} if name in _DECLARED else {}
    frame.add_command(app, function, name, **takes)
for name, (about, commands) in _GROUPS.items():
    group = typer.Typer(help=about)
    for own, function in commands.items():
        frame.add_command(group, function, own)
    app.add_typer(group, name=name)
