"""What is installed: every package, nothing twice, and a wheel that works on its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

import simrig

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUPTOOLS = PROJECT["tool"]["setuptools"]
MAPPED = {"plugins", "scenes", "evaluation"}  # folders that install as simrig.NAME


def package_of(folder: Path) -> str:
    parts = folder.relative_to(ROOT).parts
    return ".".join(("simrig", *parts) if parts[0] in MAPPED else parts)


def folders_with_code() -> set[str]:
    tops = [ROOT / "simrig", *(ROOT / name for name in MAPPED)]
    return {package_of(p.parent) for top in tops for p in top.rglob("*.py")}


def test_the_package_list_equals_the_folders() -> None:
    """A forgotten one would vanish from the wheel only."""
    assert set(SETUPTOOLS["packages"]) == folders_with_code()
    for name in SETUPTOOLS["packages"]:
        top, *rest = name.split(".")[1:] or [""]
        folder = ROOT / top if top in MAPPED else ROOT / "simrig" / top
        assert folder.joinpath(*rest, "__init__.py").is_file(), name


def test_no_folder_shadows_the_map() -> None:
    assert SETUPTOOLS["package-dir"] == {f"simrig.{name}": name for name in MAPPED}
    for name in MAPPED:
        assert not (ROOT / "simrig" / name).exists()
        assert not (ROOT / "simrig" / f"{name}.py").exists()


@pytest.mark.parametrize("name", sorted(MAPPED))
def test_a_bare_import_from_the_root_is_refused(name: str) -> None:
    code = f"import sys; sys.path.insert(0, '.'); import {name}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert f"import this package as 'simrig.{name}', not as '{name}'" in done.stderr


def test_the_version_is_stated_once() -> None:
    assert PROJECT["project"]["version"] == simrig.__version__ == metadata.version("simrig")


def test_package_data_exists() -> None:
    for package, patterns in SETUPTOOLS["package-data"].items():
        folder = ROOT / package.removeprefix("simrig.").replace(".", "/")
        for pattern in patterns:
            assert list(folder.glob(pattern)), f"{package}: {pattern} matches nothing"


def test_the_makefile_offers_what_the_readme_says() -> None:
    targets = {
        line.split(":")[0]
        for line in (ROOT / "Makefile").read_text().splitlines()
        if ":" in line and not line.startswith(("\t", ".", "#"))
    }
    readme = (ROOT / "README.md").read_text()
    for target in ("demo", "test", "test-quick", "lint", "install"):
        assert target in targets
        assert f"make {target}" in readme
    assert "make --silent test" in (ROOT / ".ci" / "run").read_text()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel from a copy, so that nothing is left in the working tree."""
    place = tmp_path_factory.mktemp("wheel")
    wanted = ("simrig", *MAPPED, "pyproject.toml", "README.md")
    for name in wanted:
        source = ROOT / name
        if source.is_dir():
            ignore = shutil.ignore_patterns("__pycache__", "*.egg-info")
            shutil.copytree(source, place / "source" / name, ignore=ignore)
        else:
            shutil.copy(source, place / "source" / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
    options = ["--no-build-isolation", "--wheel-dir", str(place), str(place / "source")]
    subprocess.run([*command, *options], check=True, timeout=300)
    (built,) = place.glob("*.whl")
    return built


@pytest.mark.slow
def test_the_wheel_holds_every_module(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    for top in ("simrig", *sorted(MAPPED)):
        for path in (ROOT / top).rglob("*"):
            if path.suffix in (".py", ".html"):
                name = path.relative_to(ROOT).as_posix()
                assert (name if top == "simrig" else f"simrig/{name}") in held


@pytest.mark.slow
def test_the_wheel_works_away_from_the_sources(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target"]
    subprocess.run([*command, str(site), str(wheel)], check=True, timeout=300)
    code = "import simrig.plugins as p, simrig.evaluation as e; print(p.__file__, e.__file__)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert all(Path(file).is_relative_to(site) for file in done.stdout.split())
    doctor = subprocess.run(
        [sys.executable, "-P", "-m", "simrig.cli", "doctor", "--json"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert doctor.returncode == 0, doctor.stdout + doctor.stderr
