"""What an experiment asks: ``experiment.toml`` of its folder, read and checked."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from simrig.core.errors import SimrigError

FILE = "experiment.toml"
PICTURES = "stimuli"
MOST_STIMULI = 500
Role = Literal["test", "practice", "exclude", "report"]
Identifier = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")]
Text = Annotated[str, Field(min_length=1, max_length=20_000)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Stimulus(_Table):
    """One picture, or a pair of them, that is asked about.

    Attributes:
        id: as in the answers.
        pictures: files in ``stimuli/``: one, or two of a comparison, which change sides by chance.
        reference: a picture above the two.
        material, group, structure_mm, rotation_deg: for the analysis.
        role: ``test``; ``practice`` comes first and is not stored as a result; ``exclude`` and
            ``report`` are checks whose failing excludes the subject or is only reported.
    """

    id: Identifier
    pictures: Annotated[list[str], Field(min_length=1, max_length=2)]
    reference: str | None = None
    material: str = ""
    group: str = ""
    structure_mm: Positive | None = None
    rotation_deg: float = 0.0
    role: Role = "test"

    @model_validator(mode="after")
    def _plain_names(self) -> Stimulus:
        for name in self.files:
            if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,80}\.(png|jpg|webp|webm)", name):
                raise ValueError(
                    f"'{name}' is no name of a picture in '{PICTURES}' (.png, .jpg, .webp, .webm)"
                )
        return self

    @property
    def files(self) -> list[str]:
        """All of its pictures."""
        return [*self.pictures, *([self.reference] if self.reference else [])]


class Display(_Table):
    """How pictures are shown.

    Attributes:
        width_mm: of a picture on the screen; where that does not fit it is shown smaller, and what
            was shown is stored.
        true_width_mm: at which angles are as in the scene from ``viewing_m``.
        viewing_m: from the eye to the screen.
    """

    width_mm: Positive = 290.0
    true_width_mm: Positive | None = None
    viewing_m: Positive = 0.6


class Limits(_Table):
    """What the server allows.

    Attributes:
        subjects: in all.
        starts_per_minute: from one address, after a burst of ``starts_at_once``.
        requests_per_second: of one session, after a burst of ``requests_at_once``.
    """

    subjects: Annotated[int, Field(ge=1)] = 10_000
    starts_at_once: Annotated[int, Field(ge=1)] = 200
    starts_per_minute: Positive = 60.0
    requests_at_once: Annotated[int, Field(ge=1)] = 120
    requests_per_second: Positive = 10.0


class Design(_Table):
    """An experiment.

    Attributes:
        title, question, instructions, consent, thanks: what subjects read.
        answers: what can be chosen, in order. Of cylinders ``0`` (none) and their numbers.
        distances_m: of the cylinders, nearest first; empty where answers are no distances.
        repeats: ids that are asked a second time, to see how steady answers are.
        stimuli: see ``Stimulus``.
    """

    title: Text
    question: Text
    instructions: Text
    consent: Text
    thanks: Text = "Thank you. Your answers are stored."
    answers: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=40)]], Field(min_length=2, max_length=60)
    ]
    distances_m: list[Positive] = []
    repeats: list[Identifier] = []
    display: Display = Display()
    limits: Limits = Limits()
    stimuli: Annotated[list[Stimulus], Field(min_length=1, max_length=MOST_STIMULI)]

    @model_validator(mode="after")
    def _consistent(self) -> Design:
        for what, names in (
            ("stimulus", [s.id for s in self.stimuli]),
            ("answer", self.answers),
            ("repeat", self.repeats),
        ):
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise ValueError(f"{what} '{twice[0]}' is there twice")
        if not any(s.role == "test" for s in self.stimuli):
            raise ValueError("no stimulus has the role 'test'")
        if any(len(s.pictures) != len(self.stimuli[0].pictures) for s in self.stimuli):
            raise ValueError("single pictures and pairs do not go together")
        if len(self.stimuli[0].pictures) == 2 and len(self.answers) != 2:
            raise ValueError(f"a pair has two answers, left and right, got {len(self.answers)}")
        unknown = set(self.repeats) - {s.id for s in self.stimuli if s.role != "practice"}
        if unknown:
            raise ValueError(f"'{sorted(unknown)[0]}' of repeats is no stimulus to be asked about")
        if self.distances_m and len(self.answers) != len(self.distances_m) + 1:
            raise ValueError(
                f"{len(self.distances_m)} distances need {len(self.distances_m) + 1} answers: "
                f"none, and one for each; got {len(self.answers)}"
            )
        if self.distances_m != sorted(set(self.distances_m)):
            raise ValueError("distances_m must rise")
        return self

    @property
    def consent_version(self) -> str:
        """A name that changes with the text that subjects agree to."""
        return hashlib.sha256(self.consent.encode()).hexdigest()[:12]

    @property
    def asked(self) -> list[Stimulus]:
        """The stimuli that are asked about, repeats at the end, without practice."""
        own = [s for s in self.stimuli if s.role != "practice"]
        return own + [s for s in own if s.id in self.repeats]

    @property
    def practice(self) -> list[Stimulus]:
        """The stimuli that come first."""
        return [s for s in self.stimuli if s.role == "practice"]


def read_design(folder: Path, pictures: bool = True) -> Design:
    """Return what the folder of an experiment asks.

    Args:
        folder: as ``simrig experiment init`` makes it.
        pictures: look whether every picture is there.

    Raises:
        SimrigError: no such folder, a file that is none, impossible settings, a missing picture.
    """
    path = folder / FILE
    if not path.is_file():
        raise SimrigError(f"'{folder}' holds no {FILE}: make it with 'simrig experiment init'")
    try:
        design = checked(tomllib.loads(path.read_text(encoding="utf-8")))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SimrigError(f"'{path}' is no TOML: {error}") from None
    except SimrigError as error:
        raise SimrigError(f"'{path}': {error}") from None
    if pictures:
        for name in sorted({p for s in design.stimuli for p in s.files}):
            if not (folder / PICTURES / name).is_file():
                raise SimrigError(f"'{folder / PICTURES / name}' is missing")
    return design


def checked(table: dict[str, Any]) -> Design:
    """Return a design from a parsed file.

    Raises:
        SimrigError: the first fault, in one line.
    """
    try:
        return Design.model_validate(table)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        place = ".".join(str(p + 1 if isinstance(p, int) else p) for p in fault["loc"])
        message = fault["msg"].removeprefix("Value error, ")
        if fault["type"] == "extra_forbidden":
            message = "unknown key"
        raise SimrigError(f"{place}: {message}" if place else message) from None


def write_design(folder: Path, design: Design) -> None:
    """Write ``experiment.toml``."""
    table = design.model_dump(exclude_none=True)
    (folder / FILE).write_text(tomli_w.dumps(table, multiline_strings=True), encoding="utf-8")
