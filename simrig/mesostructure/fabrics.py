"""Named fabrics and carpets: groups G1, G2 and G3 of thesis section B.1."""

from __future__ import annotations

from simrig.mesostructure.bsdfs import fibre
from simrig.mesostructure.fibres import Nonwoven
from simrig.mesostructure.knit import Knit
from simrig.mesostructure.pile import Carpet, Pile
from simrig.mesostructure.preset import Preset
from simrig.mesostructure.weave import Weave
from simrig.mesostructure.yarn import Yarn

_FILAMENT = fibre(roughness=0.32, anisotropic=0.85, sheen=0.0, tint=0.2)  # silk, viscose
_COTTON = fibre(roughness=0.65, anisotropic=0.5, sheen=0.25)
_WOOL = fibre(roughness=0.7, anisotropic=0.4, sheen=0.5, transmission=0.12)
_NYLON = fibre(roughness=0.28, anisotropic=0.7, sheen=0.0, transmission=0.35, tint=0.0)

_SMOOTH = (
    Preset(
        "satin_ivory",
        "fabric smooth",
        "silk satin, long floats of flat shining filament yarn",
        Weave(
            "satin_8",
            warp=Yarn((0.72, 0.62, 0.44), 0.125, 0.05, 1, look=_FILAMENT, mottle=0.05),
            weft=Yarn((0.68, 0.58, 0.40), 0.11, 0.05, 1, look=_FILAMENT, mottle=0.05),
            spacing=(0.12, 0.12),
            ends=24,
            picks=24,
            crimp=0.6,
        ),
    ),
    Preset(
        "twill_blue",
        "fabric smooth",
        "denim: blue warp over white weft, 3/1 twill",
        Weave(
            "twill_3_1",
            warp=Yarn((0.045, 0.085, 0.22), 0.29, 0.20, 7, 2.2, _COTTON, mottle=0.22),
            weft=Yarn((0.66, 0.64, 0.58), 0.26, 0.18, 7, 2.0, _COTTON),
            spacing=(0.28, 0.28),
            ends=16,
            picks=16,
        ),
    ),
    Preset(
        "poplin_white",
        "fabric smooth",
        "fine white shirt cotton, plain weave",
        Weave(
            "plain",
            warp=Yarn((0.80, 0.80, 0.78), 0.28, 0.15, 6, 2.5, _COTTON, mottle=0.04),
            weft=Yarn((0.80, 0.80, 0.78), 0.27, 0.15, 6, 2.5, _COTTON, mottle=0.04),
            spacing=(0.30, 0.33),
            ends=14,
            picks=12,
        ),
    ),
    Preset(
        "nylon_orange",
        "fabric smooth",
        "translucent nylon of thin smooth filaments, plain weave",
        Weave(
            "plain",
            warp=Yarn((0.85, 0.24, 0.03), 0.46, 0.16, 13, 0.0, _NYLON, mottle=0.05),
            weft=Yarn((0.85, 0.24, 0.03), 0.46, 0.16, 13, 0.0, _NYLON, mottle=0.05),
            spacing=(0.48, 0.48),
            ends=8,
            picks=8,
        ),
    ),
)

_MESO = (
    Preset(
        "corduroy_brown",
        "fabric meso",
        "cotton corduroy, rounded wales of cut pile",
        Pile((0.40, 0.185, 0.07), (10.0, 10.0), 2.5, 1.1),
    ),
    Preset(
        "canvas_beige",
        "fabric meso",
        "coarse linen canvas, uneven yarns in plain weave",
        Weave(
            "plain",
            warp=Yarn((0.50, 0.39, 0.25), 1.0, 0.62, 9, 0.8, _COTTON, 0.10, hairs=6.0),
            weft=Yarn((0.54, 0.43, 0.28), 1.05, 0.62, 9, 0.8, _COTTON, 0.13, hairs=6.0),
            spacing=(1.15, 1.2),
            ends=8,
            picks=8,
            sway=0.05,
        ),
    ),
    Preset(
        "herringbone_grey",
        "fabric meso",
        "woollen herringbone, light warp and dark weft",
        Weave(
            "herringbone",
            warp=Yarn((0.48, 0.47, 0.44), 0.36, 0.25, 5, 1.5, _WOOL, 0.08, 0.15, 5.0, 0.4),
            weft=Yarn((0.05, 0.05, 0.055), 0.36, 0.25, 5, 1.5, _WOOL, 0.08, 0.15, 5.0, 0.4),
            spacing=(0.34, 0.34),
            ends=16,
            picks=16,
            figure=8 * 0.34,
        ),
    ),
    Preset(
        "basket_blue",
        "fabric meso",
        "upholstery in basket weave, blue with lighter weft",
        Weave(
            "basket",
            warp=Yarn((0.03, 0.09, 0.24), 0.92, 0.60, 8, 0.9, _COTTON, 0.05),
            weft=Yarn((0.10, 0.24, 0.45), 0.92, 0.60, 8, 0.9, _COTTON, 0.05),
            spacing=(1.0, 1.0),
            ends=8,
            picks=8,
        ),
    ),
    Preset(
        "jersey_green",
        "fabric meso",
        "machine-knit jersey, rows of small loops",
        Knit(
            Yarn(
                (0.06, 0.22, 0.08), 0.52, 0.46, 6, 1.2, _COTTON, 0.06, hairs=3.0, hair_length=0.35
            ),
            wale=1.6,
            course=1.15,
            wales=5,
            courses=7,
        ),
    ),
    Preset(
        "houndstooth_black",
        "fabric meso",
        "wool check of four dark and four light yarns, twill",
        Weave(
            "twill_2_2",
            warp=Yarn((0.6, 0.58, 0.53), 0.36, 0.25, 5, 1.5, _WOOL, 0.06, 0.12, 4.0, 0.4),
            weft=Yarn((0.6, 0.58, 0.53), 0.36, 0.25, 5, 1.5, _WOOL, 0.06, 0.12, 4.0, 0.4),
            spacing=(0.35, 0.35),
            ends=16,
            picks=16,
            figure=8 * 0.35,
            warp_colours=((0.6, 0.58, 0.53),) * 4 + ((0.02, 0.02, 0.022),) * 4,
            weft_colours=((0.6, 0.58, 0.53),) * 4 + ((0.02, 0.02, 0.022),) * 4,
        ),
    ),
    Preset(
        "twill_rust",
        "fabric meso",
        "heavy upholstery twill, rust warp and ochre weft",
        Weave(
            "twill_3_1",
            warp=Yarn((0.33, 0.075, 0.025), 0.72, 0.48, 7, 1.2, _COTTON, 0.06, hairs=2.0),
            weft=Yarn((0.50, 0.29, 0.06), 0.66, 0.44, 7, 1.2, _COTTON, 0.06, hairs=2.0),
            spacing=(0.7, 0.7),
            ends=12,
            picks=12,
        ),
    ),
    Preset(
        "nonwoven_teal",
        "fabric meso",
        "spun-bonded non-woven, fibres welded in a point pattern",
        Nonwoven(
            ((0.05, 0.34, 0.33), (0.07, 0.40, 0.38)),
            (8.0, 8.0),
            0.022,
            6.0,
            3.0,
            0.30,
            curl=0.5,
            clump=0.8,
            bond=2.0,
        ),
    ),
    Preset(
        "felt_grey",
        "fabric meso",
        "wool felt of matted, winding fibres",
        Nonwoven(
            ((0.20, 0.20, 0.21), (0.33, 0.33, 0.33), (0.09, 0.09, 0.10)),
            (10.0, 10.0),
            0.025,
            5.0,
            3.0,
            0.45,
            curl=1.6,
            clump=1.6,
            look=_WOOL,
        ),
    ),
    Preset(
        "velvet_burgundy",
        "fabric meso",
        "dense even pile of silky fibres",
        Pile(
            (0.42, 0.012, 0.04),
            (8.0, 8.0),
            None,
            1.1,
            120.0,
            0.028,
            look=fibre(0.38, 0.6, sheen=1.0),
        ),
    ),
)

_ROUGH = (
    Preset(
        "carpet_loop_grey", "fabric rough", "tufted office carpet, loop pile in mixed greys",
        Carpet(
            Yarn((0.20, 0.20, 0.22), 3.2, 2.9, 9, 0.22, _WOOL, 0.06, 0.16, 1.5, 1.0, 0.02),
            gauge=(4.2, 4.4), height=4.6, tufts=(4, 4), cut=False,
            colours=((0.20, 0.20, 0.22), (0.13, 0.135, 0.15), (0.30, 0.30, 0.31)),
        ),
    ),
    Preset(
        "carpet_cut_red", "fabric rough", "tufted carpet, cut pile",
        Carpet(
            Yarn((0.45, 0.04, 0.035), 4.7, 4.7, 8, 0.03, _WOOL, mottle=0.2),
            gauge=(4.6, 4.6), height=8.0, tufts=(4, 4), cut=True,
            fibres=130,
        ),
    ),
    Preset(
        "sweater_cream", "fabric rough", "hand-knit woollen sweater of plied yarn",
        Knit(
            Yarn((0.66, 0.55, 0.38), 2.0, 1.8, 4, 0.30, _WOOL, 0.05, 0.08, 8.0, 1.2, 0.014),
            wale=6.2, course=4.4, wales=3, courses=4,
        ),
    ),
)  # fmt: skip

FABRICS = (*_SMOOTH, *_MESO, *_ROUGH)
