"""Small experiments for tests: chessboards on the cylinders of B, quick to draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simrig.scenes.cylinder_layout import cylinder_row
from simrig.web.experiment.design import PICTURES, Design, checked, write_design

ROW = cylinder_row("B")
SQUARES = (1, 2, 3, 5, 8)  # mm


def small_table(**changes: Any) -> dict[str, Any]:
    stimuli = [
        {
            "id": f"board-{mm}",
            "pictures": [f"board-{mm}.png"],
            "material": f"board {mm}",
            "group": "small" if mm < 3 else "large",
            "structure_mm": float(mm),
            "role": "exclude" if mm == 8 else "test",
        }
        for mm in SQUARES
    ]
    practice = {"id": "practice", "pictures": ["board-5.png"], "role": "practice"}
    return {
        "title": "Boards",
        "question": "How far can you see squares?",
        "instructions": "Look.",
        "consent": "I agree.",
        "answers": [str(n) for n in range(ROW.count + 1)],
        "distances_m": [round(d / 1000.0, 6) for d in ROW.distances_mm.tolist()],
        "repeats": ["board-3"],
        "display": {"width_mm": 290.0, "true_width_mm": 370.07},
        "stimuli": [*stimuli, practice],
    } | changes


def small_experiment(folder: Path, resolution: int = 540, **changes: Any) -> Design:
    """Make the folder of an experiment whose pictures are chessboards."""
    from simrig.viewing.stimuli.upright import chessboard_texture
    from simrig.web.experiment.presets import write_picture

    design = checked(small_table(**changes))
    (folder / PICTURES).mkdir(parents=True)
    for mm in SQUARES:
        path = folder / PICTURES / f"board-{mm}.png"
        write_picture(chessboard_texture(float(mm)), path, "B", resolution)
    write_design(folder, design)
    return design
