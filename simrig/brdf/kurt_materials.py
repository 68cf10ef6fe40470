"""The ten materials of thesis Table D.1, as parameters of the model of Kurt et al. 2010.

For all six materials with two lobes, the printed k_s of lobe 2 repeats that of lobe 1, which is
probably a misprint. The materials are kept as printed. A second set, named ``*_rescaled``, has
the k_s of lobe 2 multiplied by one number per material; these factors are **inferred** from the
four rounded errors of Table 5.3 each, not published.
"""

from __future__ import annotations

from simrig.brdf.analytic import Kurt, KurtLobe
from simrig.core.errors import unknown_name

# thesis Table D.1: k_d, k_s, f_0, m_x, m_y, alpha
_TABLE_D1 = """
    brushed_aluminium 0.0036 0.0034 0.0026 0.0115 0.0105 0.0075 0.999  0.035  0.129  0.005
    purple_satin      0.0026 0.0004 0.0011 0.1404 0.0522 0.0711 0.055  0.339  1.256  0
    red_velvet        0.0048 0.0005 0      0.1938 0.0333 0.0267 0.041  2.337  2.644  0
    yellow_satin      0.0066 0.0022 0.0004 0.0542 0.0345 0.0131 0.207  0.129  1.084  0.197
    fabric002         0.0805 0.0945 0.081  0.0798 0.1205 0.1796 0.3431 1.3508 0.8121 0.8359
    fabric041         0.2565 0.0703 0.0613 0.0211 0.019  0.0146 1      0.3665 1.1075 0.4984
    fabric112         0.0838 0.0596 0.0434 0.1419 0.1078 0.0521 1      1.2101 0.2139 0
    fabric135         0.0395 0.0258 0.0205 0.014  0.011  0.0087 1      1.2025 0.1029 0.5043
    fabric139         0.1607 0.153  0.135  0.0483 0.0461 0.0414 1      0.2948 1.3215 0.5753
    wood01            0.1548 0.1219 0.0836 0.0768 0.0741 0.0706 1      0.5672 0.7619 0.5051
"""
# of the second lobes: f_0, m_x, m_y, alpha, and the inferred factor of k_s, see above
_SECOND_LOBES = """
    fabric002 1      0.3168 1.0061 0.0905 0.9
    fabric041 0.1222 1.1864 0.7247 0.8356 9.8
    fabric112 1      0.7046 1.2292 0.976  0.24
    fabric135 0.3078 2.038  0.3867 0.5723 4.6
    fabric139 1      1.3281 0.3677 0.667  0.73
    wood01 1      1.7007 1.923  0.2285 2.2
"""


def _rows(table: str) -> dict[str, list[float]]:
    lines = (line.split() for line in table.strip().splitlines())
    return {name: [float(number) for number in numbers] for name, *numbers in lines}


_FIRST, _SECOND = _rows(_TABLE_D1), _rows(_SECOND_LOBES)
KURT_MATERIALS: tuple[str, ...] = tuple(_FIRST)
RESCALED_MATERIALS: tuple[str, ...] = tuple(f"{name}_rescaled" for name in _SECOND)


def kurt_material(name: str) -> Kurt:
    """Return a material of thesis Table D.1 by name.

    Args:
        name: one of ``KURT_MATERIALS`` (as printed) or ``RESCALED_MATERIALS`` (inferred).

    Raises:
        SimrigError: for an unknown name, with the nearest known one.
    """
    if name not in KURT_MATERIALS and name not in RESCALED_MATERIALS:
        raise unknown_name("material", name, KURT_MATERIALS + RESCALED_MATERIALS)
    base = name.removesuffix("_rescaled")
    row = _FIRST[base]
    k_d, k_s = (row[0], row[1], row[2]), (row[3], row[4], row[5])
    lobes = [KurtLobe(k_s, *row[6:])]
    if base in _SECOND:
        *shape, factor = _SECOND[base]
        scale = 1.0 if name == base else factor
        lobes.append(KurtLobe((scale * k_s[0], scale * k_s[1], scale * k_s[2]), *shape))
    return Kurt(k_d=k_d, lobes=tuple(lobes), name=name)
