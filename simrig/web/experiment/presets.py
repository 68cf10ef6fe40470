"""The experiments of the thesis as designs, and the pictures that they show (3.3.1, 6.3.6, B)."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.backend import native_messages_muted
from simrig.core.errors import SimrigError, check_known
from simrig.files.atomic import atomic_write
from simrig.files.images import to_srgb8
from simrig.mesostructure import PRESETS, build_tile
from simrig.scenes.cylinder_layout import cylinder_row
from simrig.scenes.perspective import focal_pixels
from simrig.scenes.stimuli import CYLINDER_RADIUS
from simrig.viewing.stimuli.pictures import FRAMES_PER_SECOND, SPEED_DEG
from simrig.viewing.stimuli.upright import (
    UprightTexture,
    chessboard_texture,
    cylinder_picture,
    upright_texture,
)
from simrig.web.experiment.design import PICTURES, Design, Stimulus, checked

# the thesis's numbers of materials in its seven groups; ours stand for them
_GROUPS = {
    "fabric smooth": 4,
    "fabric meso": 8,
    "fabric rough": 3,
    "leather meso": 3,
    "leather rough": 1,
    "wood meso": 4,
    "wood rough": 2,
}
# three fabrics and two woods are shown in three rotations (thesis Fig. B.5)
_ROTATED = ("corduroy_brown", "twill_rust", "herringbone_grey", "wood_beech", "wood_walnut")
_CHECKS = {5: "exclude", 2: "report"}  # squares in mm; thesis B.3
_PRACTICE = "houndstooth_black"
_CYLINDERS = (
    "Enter the number of the most distant cylinder on which you can still see a difference between "
    "the upper and the lower half."
)
_INSTRUCTIONS = (
    "Sit an outstretched arm (about 60 cm) away from the screen, in dim light. Every picture shows "
    "a row of cylinders that stand ever farther away. The upper half of each has an even material, "
    "the lower half its structure. Choose the number of the most distant cylinder on which you can "
    "still see a difference between the two halves; choose 0 when you see none at all. There is no "
    "time limit. Keys: arrows and Enter, or type the number and press Enter."
)
_PAIR_INSTRUCTIONS = (
    "Sit an outstretched arm (about 60 cm) away from the screen. Every page shows two pictures of "
    "one material. Choose the left or the right one. There is no time limit. Keys: arrows, Enter."
)
_CONSENT = (
    "This study asks how visible the structure of materials is. It takes ten minutes. Stored are "
    "your answers, how long each took, the size and resolution of your screen and what you "
    "measured on it; no name, no address of your computer, no cookie. Taking part is voluntary: "
    "you can stop at any time by closing the page, and the code that you get at the end deletes "
    "everything that was stored. By continuing you agree and say that you are of age."
)
PAIRS = {
    "pairs-1": "Which of the two pictures looks more realistic?",
    "pairs-2": "Which of the two pictures is more similar to the reference?",
}
_REFERENCE = "reference"
PRESET_NAMES = ("A", "B", "C", *PAIRS)


def preset(name: str) -> Design:
    """Return an experiment of the thesis.

    Args:
        name: ``A`` (20 cylinders), ``B`` (12), ``C`` (12, rotating); or ``pairs-1``, ``pairs-2``,
            the two comparisons of section 6.3.6, whose pictures are the user's.

    Raises:
        SimrigError: an unknown name, or one whose pictures nobody can make.
    """
    check_known("preset", name, PRESET_NAMES)
    if name in PAIRS:
        raise SimrigError(f"preset '{name}' compares pictures of yours: give --pictures FOLDER")
    row = cylinder_row("B" if name == "C" else name)
    true_width = 600.0 * row.size[0] / focal_pixels(row.size[1])
    stimuli = [_stimulus(material, 0.0, name) for material in _materials()]
    if name == "B":
        stimuli += [_stimulus(m, angle, name) for m in _ROTATED for angle in (45.0, 90.0)]
    stimuli += [_chessboard(size, role, name) for size, role in _CHECKS.items()]
    stimuli.append(_stimulus(_PRACTICE, 0.0, name, "practice"))
    return checked(
        {
            "title": f"Experiment {name}: the visibility of material structure",
            "question": _CYLINDERS,
            "instructions": _INSTRUCTIONS,
            "consent": _CONSENT,
            "answers": [str(n) for n in range(row.count + 1)],
            "distances_m": [float(d) / 1000.0 for d in row.distances_mm.round(6)],
            "display": {
                "width_mm": round(true_width, 1) if name == "A" else 290.0,
                "true_width_mm": round(true_width, 3),
            },
            "stimuli": [s.model_dump(exclude_none=True) for s in stimuli],
        }
    )


def pair_design(name: str, pictures: list[Path]) -> Design:
    """Return a comparison of pairs of pictures (thesis 6.3.6).

    Args:
        name: ``pairs-1`` or ``pairs-2``.
        pictures: ``MATERIAL-reference.png`` beside one or more ``MATERIAL-METHOD.png``.

    Raises:
        SimrigError: names that make no pair.
    """
    methods: dict[str, list[str]] = {}
    for picture in pictures:
        material, _, method = picture.stem.rpartition("-")
        methods.setdefault(material, []).append(method)
    suffix = pictures[0].suffix if pictures else ""
    pairs: list[dict[str, Any]] = []
    for material, own in sorted(methods.items()):
        if _REFERENCE not in own:
            continue
        others = sorted(set(own) - {_REFERENCE})
        shown = (
            [(_REFERENCE, other) for other in others]
            if name == "pairs-1"
            else list(itertools.combinations(others, 2))
        )
        reference = {"reference": f"{material}-{_REFERENCE}{suffix}"} if name == "pairs-2" else {}
        pairs += [
            {
                "id": "-".join((material, *pair)).lower(),
                "pictures": [f"{material}-{method}{suffix}" for method in pair],
                "material": material,
                "group": " or ".join(pair),
                **reference,
            }
            for pair in shown
        ]
    if not pairs:
        raise SimrigError(
            f"{name} needs pictures 'MATERIAL-reference.png' beside 'MATERIAL-METHOD.png'"
            + (", two methods at least" if name == "pairs-2" else "")
        )
    return checked(
        {
            "title": "Comparison of renderings",
            "question": PAIRS[name],
            "instructions": _PAIR_INSTRUCTIONS,
            "consent": _CONSENT,
            "answers": ["left", "right"],
            "display": {"width_mm": 290.0},
            "stimuli": pairs,
        }
    )


def _materials() -> list[str]:
    found = []
    for group, count in _GROUPS.items():
        own = [name for name, made in PRESETS.items() if made.group == group]
        first = [name for name in own if name in _ROTATED]
        found += (first + [name for name in own if name not in first])[:count]
    return found


def _stimulus(material: str, rotation: float, experiment: str, role: str = "test") -> Stimulus:
    made = PRESETS[material]
    suffix = f"-{rotation:.0f}" if rotation else ""
    name = f"{material}{suffix}"
    moving = "webm" if experiment == "C" else "png"
    about: dict[str, Any] = {
        "material": material,
        "group": made.group,
        "structure_mm": made.structure.element_mm,
        "rotation_deg": rotation,
        "role": role,
    }
    own = f"practice-{name}" if role == "practice" else name
    return Stimulus(id=own, pictures=[f"{name}.{moving}"], **about)


def _chessboard(size: int, role: Any, experiment: str) -> Stimulus:
    name, moving = f"chessboard-{size}", "webm" if experiment == "C" else "png"
    return Stimulus(
        id=name, pictures=[f"{name}.{moving}"], material=name, structure_mm=float(size), role=role
    )


def make_pictures(
    design: Design,
    experiment: str,
    folder: Path,
    resolution: int | None,
    progress: Callable[..., None],
) -> int:
    """Make the pictures of a preset that a folder lacks.

    Args:
        design: ``preset(experiment)``.
        experiment: ``A``, ``B`` or ``C``.
        folder: of the experiment.
        resolution: width in pixels; by default the published one, of C 1080.
        progress: called with pictures done and in total.

    Returns:
        How many were made now.
    """
    from simrig.core import backend

    backend.select()
    (folder / PICTURES).mkdir(exist_ok=True)
    lacking = {
        stimulus.pictures[0]: stimulus
        for stimulus in design.stimuli
        if not (folder / PICTURES / stimulus.pictures[0]).exists()
    }
    for number, (name, stimulus) in enumerate(lacking.items()):
        progress(number, len(lacking), stimulus.id)
        texture = _texture(stimulus)
        with atomic_write(folder / PICTURES / name) as temporary:
            if experiment == "C":
                write_film(texture, temporary, resolution or 1080)
            else:
                write_picture(texture, temporary, experiment, resolution)
    return len(lacking)


def _texture(stimulus: Stimulus) -> UprightTexture:
    _, board, side = stimulus.material.partition("chessboard-")
    if board:
        return chessboard_texture(float(side))
    return upright_texture(build_tile(stimulus.material), stimulus.rotation_deg)


def write_picture(
    texture: UprightTexture, path: Path, experiment: str, resolution: int | None
) -> None:
    """Write the receding cylinders as a PNG, a white diffuser under the right light white."""
    import cv2

    image = to_srgb8(cylinder_picture(texture, experiment, resolution))
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 4])


def write_film(texture: UprightTexture, path: Path, resolution: int) -> None:
    """Write rotating cylinders as a film that repeats: the tile moves on by one width.

    The visible part of a cylinder shows no seam, so none is covered.
    """
    import cv2

    size = cylinder_row("B").picture(resolution)
    width_mm = texture.radiance.shape[3] * texture.texel_mm[0]
    period_deg = float(np.degrees(width_mm / CYLINDER_RADIUS))
    count = max(1, round(period_deg / SPEED_DEG * FRAMES_PER_SECOND))
    with native_messages_muted():  # it says that WebM has no tag of this name, and writes it
        film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP90"), FRAMES_PER_SECOND, size)
    if not film.isOpened():
        raise SimrigError(
            "this OpenCV cannot write VP9 films: install opencv-contrib-python-headless"
        )
    for number in range(count):
        turned = cylinder_picture(texture, "B", resolution, period_deg * number / count)
        film.write(np.ascontiguousarray(to_srgb8(turned)[..., ::-1]))
    film.release()
