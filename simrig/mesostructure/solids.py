"""Named leathers (G4, G5), woods (G6, G7), sandpapers and tiles."""

from __future__ import annotations

from simrig.mesostructure.ceramic import Mosaic
from simrig.mesostructure.grains import Sandpaper
from simrig.mesostructure.leather import Leather
from simrig.mesostructure.preset import Preset
from simrig.mesostructure.wood import Spindles, Wood

_LEATHERS = (
    Preset(
        "leather_black",
        "leather meso",
        "synthetic leather, fine even embossed grain",
        Leather(
            (0.022, 0.021, 0.022),
            (10.0, 10.0),
            pebble=1.0,
            depth=0.14,
            crease=0.17,
            regularity=5,
            warp=0.07,
            roughness=0.38,
        ),
        256,
    ),
    Preset(
        "leather_tan",
        "leather meso",
        "synthetic upholstery leather, rounded pebbles",
        Leather(
            (0.42, 0.21, 0.085),
            (16.0, 16.0),
            pebble=1.9,
            depth=0.22,
            crease=0.16,
            regularity=3,
            warp=0.10,
        ),
        256,
    ),
    Preset(
        "leather_nappa",
        "leather meso",
        "genuine nappa, flat irregular grain with hair pores",
        Leather(
            (0.115, 0.042, 0.022),
            (12.0, 12.0),
            pebble=1.4,
            depth=0.10,
            crease=0.13,
            regularity=0,
            warp=0.20,
            stretch=1.35,
            wrinkle=0.008,
            pores=1.6,
            fine=0.35,
            roughness=0.45,
        ),
        256,
    ),
    Preset(
        "leather_cognac",
        "leather rough",
        "genuine rough leather, high pebbles and deep creases",
        Leather(
            (0.24, 0.085, 0.026),
            (32.0, 32.0),
            pebble=4.2,
            depth=0.75,
            crease=0.15,
            regularity=2,
            warp=0.08,
            stretch=1.1,
            unevenness=0.08,
            wrinkle=0.012,
            fine=0.22,
            roughness=0.40,
            patina=0.6,
        ),
        384,
    ),
)

_WOODS = (
    Preset(
        "wood_beech",
        "wood meso",
        "beech, pale with short dark ray flecks",
        Wood(
            (0.60, 0.38, 0.21),
            (0.50, 0.29, 0.145),
            (20.0, 20.0),
            rings=4,
            waviness=0.4,
            vessels=Spindles(1.2, 0.07, 2.5, (0.36, 0.20, 0.10), 0.02),
            rays=Spindles(3.0, 0.30, 0.30, (0.30, 0.145, 0.065), 0.01),
        ),
        256,
    ),
    Preset(
        "wood_beech_steamed",
        "wood meso",
        "steamed beech, reddish with short dark ray flecks",
        Wood(
            (0.43, 0.205, 0.105),
            (0.34, 0.145, 0.07),
            (20.0, 20.0),
            rings=5,
            waviness=0.4,
            vessels=Spindles(1.2, 0.07, 2.5, (0.24, 0.10, 0.05), 0.02),
            rays=Spindles(2.6, 0.28, 0.40, (0.19, 0.07, 0.03), 0.01),
        ),
        256,
    ),
    Preset(
        "wood_lime",
        "wood meso",
        "European lime, very pale and fine, hardly any figure",
        Wood(
            (0.68, 0.50, 0.31),
            (0.60, 0.42, 0.24),
            (16.0, 16.0),
            rings=3,
            waviness=0.4,
            vessels=Spindles(1.6, 0.07, 3.0, (0.50, 0.33, 0.18), 0.02),
            rays=Spindles(1.4, 0.12, 0.5, (0.46, 0.29, 0.15)),
        ),
        256,
    ),
    Preset(
        "wood_plane",
        "wood meso",
        "plane, lace of dense broad ray flecks",
        Wood(
            (0.47, 0.27, 0.145),
            (0.42, 0.23, 0.12),
            (22.0, 22.0),
            rings=3,
            waviness=0.4,
            vessels=Spindles(1.2, 0.08, 2.0, (0.30, 0.15, 0.075), 0.02),
            rays=Spindles(5.5, 0.85, 0.28, (0.24, 0.105, 0.05), 0.015),
        ),
        256,
    ),
    Preset(
        "wood_walnut",
        "wood rough",
        "American walnut, dark streaks and long open pores",
        Wood(
            (0.22, 0.110, 0.054),
            (0.075, 0.034, 0.017),
            (36.0, 36.0),
            rings=6,
            waviness=0.12,
            vessels=Spindles(9.0, 0.26, 0.32, (0.016, 0.008, 0.005), 0.16, evenness=2),
            rays=Spindles(1.5, 0.10, 0.6, (0.12, 0.06, 0.03)),
            clustering=0.35,
            streak=60.0,
            fibre_relief=0.01,
            roughness=0.5,
            specular=0.2,
        ),
        384,
    ),
    Preset(
        "wood_wenge",
        "wood rough",
        "wenge, nearly black with light bands and long grooves",
        Wood(
            (0.105, 0.055, 0.026),
            (0.014, 0.008, 0.005),
            (30.0, 30.0),
            rings=12,
            waviness=0.12,
            vessels=Spindles(12.0, 0.30, 0.15, (0.15, 0.09, 0.045), 0.18),
            rays=Spindles(1.5, 0.10, 0.5, (0.02, 0.011, 0.007)),
            clustering=0.3,
            fibre_relief=0.015,
            roughness=0.5,
            specular=0.2,
        ),
        320,
    ),
)

_OTHER = (
    Preset(
        "sandpaper_p60", "other", "coarse brown corundum sandpaper",
        Sandpaper((6.0, 6.0), 0.27, (0.22, 0.10, 0.055), (0.13, 0.06, 0.03)),
    ),
    Preset(
        "sandpaper_p24", "other", "very coarse black silicon carbide sandpaper",
        Sandpaper((12.0, 12.0), 0.75, (0.055, 0.056, 0.062), (0.03, 0.03, 0.032)),
    ),
    Preset(
        "tile_white", "other", "white glazed mosaic with grey joints",
        Mosaic(((0.78, 0.78, 0.75),), 10.0, 1.5, (2, 2)), 320,
    ),
    Preset(
        "tile_blue", "other", "small glazed mosaic in blues with light joints",
        Mosaic(((0.02, 0.09, 0.26), (0.03, 0.16, 0.34), (0.05, 0.24, 0.40)), 5.0, 0.9, (4, 4),
               (0.6, 0.58, 0.54)), 320,
    ),
)  # fmt: skip

SOLIDS = (*_LEATHERS, *_WOODS, *_OTHER)
