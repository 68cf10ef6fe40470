"""Shared fixtures: measured data where it is present, Mitsuba variants, one random generator."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest

try:
    import simrig
except ImportError as error:  # pragma: no cover
    raise pytest.UsageError("simrig is not installed: run 'make install' first") from error

# The same examples in every run, and no limit on the time of one; ``make test-random`` draws others
hypothesis.settings.register_profile("simrig", derandomize=True, deadline=None)
hypothesis.settings.register_profile("random", derandomize=False, deadline=None, database=None)
hypothesis.settings.load_profile("simrig")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session", autouse=True)
def hear_interrupts() -> Iterator[None]:
    """Let Ctrl-C reach the tests of it: a shell has it ignored in what runs in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module", autouse=True)
def begin_with_the_usual_variant() -> None:
    """Let no file of tests inherit the variant that another one ended with."""
    mi = sys.modules.get("mitsuba")
    if mi is not None and mi.variant() not in (None, "llvm_ad_rgb"):
        mi.set_variant("llvm_ad_rgb")


@pytest.fixture
def shared_data() -> Callable[[str], Path]:
    """Return a function that gives the path of a measured data file, or skips the test."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"measured data '{name}' is not present beside the repository")
        return path

    return find


@pytest.fixture
def in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run the test in an empty folder, and return that."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def small_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a user's own folder of four BRDFs, one of them in a folder of its own."""
    from simrig.brdf import kurt_material
    from simrig.brdf.tables.resample import resample_dense
    from simrig.files.hdf5 import write_brdf

    place = tmp_path_factory.mktemp("mine")
    (place / "satins").mkdir()
    for name in ("fabric112", "purple_satin", "fabric002", "fabric041"):
        where = place / "satins" if "satin" in name else place
        table = resample_dense(kurt_material(name), np.radians(15.0), 24, np.radians(75.0))
        write_brdf(where / f"{name}.h5", table)
    (place / "notes.txt").write_text("not a material")
    return place


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a random generator with a fixed seed."""
    return np.random.default_rng(20261122)


@pytest.fixture
def variant_llvm() -> Iterator[str]:
    """Select ``llvm_ad_rgb`` with the simrig plugins registered."""
    from simrig.core import backend

    yield backend.select("llvm_ad_rgb")


@pytest.fixture(scope="session")
def measured() -> Callable[..., Any]:
    """Return a function that measures a built-in material along slices."""
    from simrig.brdf import kurt_material
    from simrig.plans.along_slices import SlicePlan
    from simrig.plans.placement import SlicePlacement
    from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

    def measure(
        name="fabric112", steps=(20, 60), samples=2272, checkpoint=None, progress=None, **settings
    ):
        plan = SlicePlan(SlicePlacement.from_degrees(*steps), samples, **settings)
        rig = Gonioreflectometer()
        return rig.measure(kurt_material(name), plan, checkpoint=checkpoint, progress=progress)

    return measure


assert simrig.__version__
