"""``simrig experiment``: people look at stimuli on the web (thesis sections 3.3, 6.3.6 and B)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import IntoFolder
from simrig.cli.outputs import output_folder
from simrig.core.errors import SimrigError

_Folder = Annotated[Path, typer.Argument(help="The folder of an experiment.")]
_Database = Annotated[
    str | None,
    typer.Option(help="postgresql://USER@HOST/NAME; a file in the folder (SQLite) else."),
]
_Seed = Annotated[int, typer.Option(min=0, help="Of the random numbers.")]


def init(
    folder: Annotated[Path, typer.Argument(help="The folder to make.")],
    preset: Annotated[
        str | None,
        typer.Option(help="A, B, C (cylinders), pairs-1 or pairs-2 (pairs of pictures)."),
    ] = None,
    design: Annotated[
        Path | None, typer.Option(help="Instead: an experiment of your own (.toml).")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="A folder with its pictures, or those of the pairs.")
    ] = None,
    resolution: Annotated[
        int | None, typer.Option(min=64, help="Width of the cylinders in pixels; as published.")
    ] = None,
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Make the folder of an experiment: its questions (experiment.toml) and its pictures.

    Pictures of a preset are rendered now; what is interrupted goes on from those that are there.
    """
    from simrig.web.experiment import making

    if (preset is None) == (design is None):
        raise SimrigError("give either --preset or --design")
    asked, source = making.asked(preset, design, pictures)
    if preset is None or source is not None:
        frame.refuse_unused("the pictures are there", "resolution")
    else:
        frame.refuse_unused(f"preset {preset} makes its pictures", "pictures")
    request = {
        "design": asked.model_dump(),
        "resolution": resolution,
        "pictures": making.stamps(source, asked),
    }
    with (
        output_folder(folder, overwrite, request) as working,
        frame.progress("pictures") as report,
    ):
        made = making.make(working, asked, preset, source, resolution, report)
    said = f"{len(asked.asked)} questions, {made} pictures made; next: simrig experiment serve"
    data = {"folder": folder, "questions": len(asked.asked), "pictures": made}
    return frame.Report(data, [f"{folder}: {said} {folder}"])


def serve(
    folder: _Folder,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 0,
    host: Annotated[str, typer.Option(help="Whom to listen to: this machine only.")] = "127.0.0.1",
    database: _Database = None,
    public: Annotated[
        str | None, typer.Option(help="Origin under which a proxy with TLS publishes it.")
    ] = None,
) -> frame.Report:
    """Serve an experiment until Ctrl-C; the first line that is printed is its address."""
    from simrig.web.experiment.serve import prepared
    from simrig.web.listen import listening, origins_of

    sock = listening(host, port)
    try:
        server = prepared(folder, sock, database, public)
    except BaseException:
        sock.close()
        raise
    origin = origins_of(sock)[0]
    publish = (
        f"published as {public}"
        if public
        else "only this machine can reach it; to publish it, let a web server with TLS pass "
        "https://lab.example on to this address, and add --public https://lab.example"
    )
    shown = [f"{origin}/", f"{publish}; Ctrl-C ends"]
    return frame.Report({"address": f"{origin}/", "public": public}, shown, then=server)


def load(
    folder: _Folder,
    subjects: Annotated[int, typer.Option(min=1, max=5000, help="Virtual observers.")] = 100,
    at_once: Annotated[
        int | None,
        typer.Option(min=1, max=1000, help="At the same time; all of them unless given."),
    ] = None,
    kills: Annotated[
        int, typer.Option(min=0, max=20, help="Times that the server is killed meanwhile.")
    ] = 2,
    think: Annotated[
        float, typer.Option(min=0.0, max=60.0, help="Seconds that an answer takes on average.")
    ] = 1.0,
    database: _Database = None,
    seed: _Seed = 0,
) -> frame.Report:
    """Let virtual observers take part over HTTP, all at once, and count what was lost.

    They look at the real pictures. One in ten answers is sent twice, sessions are reloaded. Where
    the folder is served already that server is asked and not killed.
    """
    from simrig.web.experiment.load import run_load

    with frame.progress("answers") as report:
        found = run_load(
            folder,
            subjects,
            at_once=at_once or subjects,
            kills=kills,
            think_s=think,
            database=database,
            seed=seed,
            progress=report,
        )
    bad = bool(found["lost"] or found["errors"])
    rows = [(key, value) for key, value in found.items() if not isinstance(value, dict)]
    return frame.Report(found, [frame.table(("what", "count"), rows)], exit_code=int(bad))


def export(
    folder: _Folder,
    output: Annotated[Path, typer.Option(help="The folder for the tables.")],
    database: _Database = None,
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Write all answers as tables: answers.csv, subjects.csv and the design."""
    from simrig.web.experiment.export import write_tables

    with output_folder(output, overwrite, {"folder": folder.resolve(), "database": database}) as to:
        counts = write_tables(folder, to, database)
    said = ", ".join(f"{count} {what}" for what, count in counts.items())
    return frame.Report({"output": output, **counts}, [f"{output}: {said}"])


def delete(
    folder: _Folder,
    subject: Annotated[int, typer.Argument(min=1, help="As in subjects.csv.")],
    database: _Database = None,
) -> frame.Report:
    """Delete a subject and everything that is stored of it."""
    from simrig.web.experiment.export import delete_subject

    delete_subject(folder, subject, database)
    return frame.Report({"subject": subject, "deleted": True}, [f"subject {subject} is deleted"])


def analyse(
    tables: Annotated[Path, typer.Argument(help="The folder that 'export' wrote.")],
    output: Annotated[
        Path | None, typer.Option(help="A folder for results.json and the figures.")
    ] = None,
    beside: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=FOLDER", help="Another experiment to correlate with (Table B.1)."
        ),
    ] = None,
    observers: Annotated[
        str, typer.Option(help="people, virtual, all; people where there are any.")
    ] = "auto",
    lapses: Annotated[
        str, typer.Option(help="Of the fits: none (λ = 0), or shared (one λ for all, up to 0.06).")
    ] = "none",
    effective: Annotated[
        bool, typer.Option("--effective", help="Distances as the shown size makes them.")
    ] = False,
    bootstrap: Annotated[
        int, typer.Option(min=0, max=10000, help="Resamplings; 0 leaves intervals out.")
    ] = 500,
    features: Annotated[
        Path | None, typer.Option(help="features.csv (stimulus and values), to fit predictors.")
    ] = None,
    seed: _Seed = 0,
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Analyse answers: filters, averages, psychometric fits with intervals, correlations."""
    from simrig.cli.assignments import assignments
    from simrig.web.experiment.analysis.analyse import analyse_tables

    others = assignments("--beside", "NAME=FOLDER", beside)
    settings: dict[str, Any] = {
        "others": {name: Path(place) for name, place in others.items()},
        "observers": observers,
        "lapses": lapses,
        "effective": effective,
        "bootstrap": bootstrap,
        "features": features,
        "seed": seed,
    }
    with frame.progress("analysis") as report:
        results = analyse_tables(tables, **settings, progress=report)
    if output is not None:
        from simrig.web.experiment.analysis.figures import write_results

        with output_folder(output, overwrite, frame.plain(settings | {"tables": tables})) as to:
            write_results(results, to)
    return frame.Report(results, _shown(results))


def _shown(results: dict[str, Any]) -> list[Any]:
    """Return what a person reads of an analysis."""
    kept = results["filters"]
    counts = ", ".join(
        f"{kept[key]} {key}" for key in ("kept", "beyond_pixels", "excluded_subjects")
    )
    shown: list[Any] = [f"{results['observers']}: {results['subjects']} subjects; {counts}"]
    if "groups" in results:
        columns = ("group", "answers", "mean / m", "d25 / m", "d50 / m", "extrapolated", "fit p")
        rows = [
            (
                name,
                row["answers"],
                *(_number(row[key]) for key in ("mean_m", "d25_m", "d50_m")),
                "yes" if row["extrapolated"] else "",
                _number(row["goodness_p"]),
            )
            for name, row in results["groups"].items()
        ]
        shown.append(frame.table(columns, rows))
    if "choices" in results:
        heads = ("stimulus", "answers", "first chosen", "95 %")
        chosen = [
            (
                name,
                row["answers"],
                _number(row["share"]),
                " to ".join(map(_number, row["interval"])),
            )
            for name, row in results["choices"].items()
        ]
        shown.append(frame.table(heads, chosen))
    return shown


def _number(value: float | None) -> str:
    return "" if value is None or value != value else f"{value:.2f}"
