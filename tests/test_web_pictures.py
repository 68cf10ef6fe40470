"""Pictures of upright cylinders from few images, beside those that Mitsuba renders from a BTF."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.btf.synthetic import chessboard
from simrig.core import backend
from simrig.scenes.cylinder_layout import cylinder_row
from simrig.viewing.stimuli.materials import StimulusMaterial
from simrig.viewing.stimuli.pictures import CylinderStimulus
from simrig.viewing.stimuli.upright import chessboard_texture, cylinder_picture
from simrig.web.experiment.presets import preset

WIDTH = 540


@pytest.mark.slow
def test_a_chessboard_looks_as_mitsuba_renders_it() -> None:
    """Diffuse squares, so that only geometry, light and filtering can differ."""
    backend.select()
    ours = cylinder_picture(chessboard_texture(5.0), "B", WIDTH)
    theirs = CylinderStimulus(StimulusMaterial(chessboard(5.0)), "B", WIDTH, 256).picture().image
    assert ours.shape == theirs.shape
    middle = ours.shape[0] // 2
    upper = np.abs(ours - theirs)[: middle - 1]
    assert upper.mean() < 2e-3
    # a filter of another width blurs the edges of squares, and the phase of the tile is free
    low, high = ours[middle + 1 :], theirs[middle + 1 :]
    assert low.mean() == pytest.approx(high.mean(), rel=0.01)
    first = slice(20, 100)  # the nearest cylinder
    assert low[:60, first].std() == pytest.approx(high[:60, first].std(), rel=0.12)


def test_far_squares_blur_to_their_mean_without_aliases() -> None:
    picture = cylinder_picture(chessboard_texture(0.5), "B", WIDTH)
    middle = picture.shape[0] // 2
    upper, lower = picture[middle - 8 : middle - 2], picture[middle + 2 : middle + 8]
    lit = upper.mean(axis=0) > 0.05
    lit[:140] = False  # the nearest shows squares
    assert lower.mean(axis=0)[lit] == pytest.approx(upper.mean(axis=0)[lit], abs=0.03)


def test_preset_b_is_the_thesis_experiment() -> None:
    design = preset("B")
    assert len(design.asked) == 37
    assert design.distances_m == pytest.approx((cylinder_row("B").distances_mm / 1000.0).tolist())
    groups = [s.group for s in design.asked if s.rotation_deg == 0.0 and s.group]
    assert [groups.count(g) for g in dict.fromkeys(groups)] == [4, 8, 3, 3, 1, 4, 2]
    assert sum(s.rotation_deg > 0.0 for s in design.asked) == 10
    assert len(preset("A").asked) == len(preset("C").asked) == 27
    assert len(preset("A").answers) == 21
