"""What is installed: every package, nothing twice, and a wheel that works on its own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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


def requirements() -> list[Requirement]:
    project = PROJECT["project"]
    extras = [line for lines in project["optional-dependencies"].values() for line in lines]
    lines = [*project["dependencies"], *extras, *PROJECT["build-system"]["requires"]]
    return [found for found in map(Requirement, lines) if found.name != "simrig"]


def constraints() -> dict[str, str]:
    """Return the tested version of each package; fail at a line that is not NAME==VERSION."""
    lines = (ROOT / ".ci" / "constraints.txt").read_text().splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    assert all(len(pair) == 2 and not re.search(r"[/@: ]", pair[0] + pair[1]) for pair in pairs)
    assert len({canonicalize_name(name) for name, _ in pairs}) == len(pairs)
    return {canonicalize_name(name): version for name, version in pairs}


def test_every_dependency_has_a_tested_version_within_its_range() -> None:
    tested = constraints()
    for wanted in requirements():
        name = canonicalize_name(wanted.name)
        assert name in tested, f"{name}: no line in .ci/constraints.txt; 'make constraints'"
        assert tested[name] in wanted.specifier, f"{name}: {tested[name]} is not {wanted.specifier}"


def test_what_dependencies_need_has_a_tested_version_too() -> None:
    """A package that a fresh machine would pick for itself could be one that nobody tested."""
    tested = constraints()
    todo = [(canonicalize_name(wanted.name), wanted.extras) for wanted in requirements()]
    seen = set()
    while todo:
        name, extras = todo.pop()
        assert name in tested, f"{name}: no line in .ci/constraints.txt; 'make constraints'"
        if (name, frozenset(extras)) in seen:
            continue
        seen.add((name, frozenset(extras)))
        for line in metadata.requires(name) or []:
            wanted = Requirement(line)
            environments = [{"extra": extra} for extra in (*extras, "")]
            if wanted.marker is None or any(map(wanted.marker.evaluate, environments)):
                todo.append((canonicalize_name(wanted.name), wanted.extras))


def test_the_setup_takes_the_tested_versions() -> None:
    assert "--constraint .ci/constraints.txt" in (ROOT / ".ci" / "setup").read_text()


def test_the_licence_and_the_citation_agree_with_the_package() -> None:
    project = PROJECT["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    licence = (ROOT / "LICENSE").read_text()
    (author,) = project["authors"]
    assert project["license"] == citation["license"] == "BSD-3-Clause"
    assert licence.startswith("BSD 3-Clause") and author["name"] in licence
    assert citation["authors"] == [author]
    assert str(citation["version"]) == project["version"]
    assert f"## {project['version']}" in (ROOT / "CHANGELOG.md").read_text()
    (thesis,) = citation["references"]
    title = thesis["title"]
    assert title in (ROOT / "docs" / "bibliography.md").read_text()
    assert title in (ROOT / "README.md").read_text()


def test_package_data_exists() -> None:
    for package, patterns in SETUPTOOLS["package-data"].items():
        top, *rest = package.split(".")[1:] or [""]
        folder = (ROOT / top if top in MAPPED else ROOT / "simrig" / top).joinpath(*rest)
        for pattern in patterns:
            assert list(folder.glob(pattern)), f"{package}: {pattern} matches nothing"


def test_the_makefile_offers_what_the_readme_says() -> None:
    targets = {
        line.split(":")[0]
        for line in (ROOT / "Makefile").read_text().splitlines()
        if ":" in line and not line.startswith(("\t", ".", "#"))
    }
    readme = (ROOT / "README.md").read_text() + (ROOT / "docs" / "start.md").read_text()
    for target in (
        "demo",
        "docs",
        "test",
        "test-quick",
        "test-random",
        "coverage",
        "lint",
        "install",
    ):
        assert target in targets
        assert f"make {target}" in readme
    assert "make --silent test" in (ROOT / ".ci" / "run").read_text()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel from a copy, so that nothing is left in the working tree."""
    place = tmp_path_factory.mktemp("wheel")
    wanted = ("simrig", *MAPPED, "pyproject.toml", "README.md", "LICENSE")
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
            if path.suffix in (".py", ".html", ".toml", ".typed"):
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
