"""Importing ``simrig.plugins`` is enough: in any order, in every variant, without our backend."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LLVM_15 = Path("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1")

# f_r cos of fabric112 seen from the normal and lit at 30 degrees, as the variant transports it,
# beside the luminance of what NumPy computes; spectra are summed under D65 by Mitsuba
START = """
import numpy as np
import mitsuba as mi
import drjit as dr

WI = np.array([0.0, 0.0, 1.0])
WO = np.array([0.5, 0.0, np.sqrt(0.75)])
MATERIAL = {"type": "simrig_kurt", "material": "fabric112"}

def luminance():
    bsdf = mi.load_dict(MATERIAL)
    si = dr.zeros(mi.SurfaceInteraction3f, 95 if mi.is_spectral else 1)
    si.wi = mi.Vector3f(*WI.tolist())
    if mi.is_spectral:
        nm = 360.0 + 5.0 * dr.arange(mi.Float, 95)
        si.wavelengths = type(si.wavelengths)(nm)
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*WO.tolist()))
    if mi.is_polarized:
        assert np.all(np.array(value[0, 1]) == 0.0) and np.all(np.array(value[1, 1]) == 0.0)
        value = value[0, 0]
    if mi.is_spectral:
        d65 = mi.load_dict({"type": "d65"}).eval(si)[0]
        y = mi.cie1931_xyz(nm).y
        return float((dr.sum(value[0] * d65 * y) / dr.sum(d65 * y))[0])
    if mi.is_monochromatic:
        return float(value[0][0])
    return float(mi.luminance(value)[0])

def check(*variants):
    for variant in variants:
        mi.set_variant(variant)
        found = luminance()
        from simrig.brdf import evaluate, kurt_material
        rgb = evaluate(kurt_material("fabric112"), WO, WI) * WO[2]
        truth = rgb @ [0.212671, 0.715160, 0.072169]
        assert abs(found - truth) < 2e-3 * truth, (variant, found, truth)
        print(variant)
"""


def python(code: str, library: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ)
    if library is not None:
        environment["DRJIT_LIBLLVM_PATH"] = str(library)
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120
    )


def printed(code: str) -> list[str]:
    done = python(code)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.split()


RGB_SPECTRAL_MONO = ("llvm_ad_rgb", "llvm_ad_spectral", "llvm_ad_mono")


@pytest.mark.parametrize(
    ("first", "then"),
    [
        ("import mitsuba as mi\nmi.set_variant('llvm_ad_mono')", "import simrig.plugins"),
        ("import simrig.plugins", "mi.set_variant('llvm_ad_rgb')"),
    ],
    ids=["variant first", "plugins first"],
)
def test_plugins_are_there_in_every_variant_and_order(first: str, then: str) -> None:
    again = (*RGB_SPECTRAL_MONO, "llvm_ad_rgb")
    assert printed(f"{first}\n{START}\n{then}\ncheck{again}") == list(again)


@pytest.mark.slow
def test_polarised_variants_see_depolarised_light() -> None:
    variants = ("llvm_ad_mono_polarized", "llvm_ad_spectral_polarized")
    assert printed(f"{START}\nimport simrig.plugins\ncheck{variants}") == list(variants)


@pytest.mark.parametrize("order", ["plugins first", "variant first"])
def test_an_llvm_that_would_abort_is_refused_with_the_cure(order: str) -> None:
    if not LLVM_15.exists():
        pytest.skip("libLLVM 15 is not installed here")
    steps = ["import simrig.plugins", "mi.set_variant('llvm_ad_rgb')"]
    lines = "\n    ".join(steps if order == "plugins first" else steps[::-1])
    done = python(
        f"import mitsuba as mi\ntry:\n    {lines}\n"
        "except ValueError as error:\n    print(type(error).__name__, error)",
        LLVM_15,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("SimrigError variant 'llvm_ad_rgb' cannot run here: libLLVM 15")
    assert "apt-get install libllvm19" in done.stdout


def test_simrig_alone_imports_no_mitsuba() -> None:
    code = "import sys, simrig\nprint(sorted({'mitsuba', 'drjit', 'numpy'} & set(sys.modules)))"
    assert python(code).stdout == "[]\n"
