"""package.xml, setup.py, LICENSE and CITATION.cff of the packages agree."""

from __future__ import annotations

import ast
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = sorted(path.parent for path in (ROOT / "ros2_ws/src").glob("*/package.xml"))
IN_PYTHON = [p for p in PACKAGES if (p / "setup.py").exists()]
SAME = ("name", "version", "description", "license", "author", "maintainer")
MORE = ("maintainer_email", "install_requires")
# Not in apt on Ubuntu 24.04, or part of every Python there.
NOT_IN_APT = {"mcap", "rosbags", "setuptools"}


def manifest(package: Path) -> ElementTree.Element:
    return ElementTree.parse(package / "package.xml").getroot()


def text(package: Path, tag: str) -> str:
    (found,) = manifest(package).findall(tag)
    return found.text or ""


def setup_arguments(package: Path) -> dict[str, Any]:
    """The arguments of setup() that are written out."""
    calls = [n for n in ast.walk(ast.parse((package / "setup.py").read_text())) if isinstance(n, ast.Call)]
    (call,) = (c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "setup")
    return {k.arg: ast.literal_eval(k.value) for k in call.keywords if k.arg in SAME or k.arg in MORE}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.name)
def test_all_packages_have_one_version_licence_and_maintainer(package: Path) -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert text(package, "name") == package.name
    assert text(package, "version") == citation["version"]
    assert text(package, "license") == citation["license"]
    assert text(package, "maintainer") == text(package, "author") == citation["authors"][0]["name"]


def test_the_packages_are_three_that_agree_and_name_a_maintainer_and_a_licence() -> None:
    assert [package.name for package in PACKAGES] == ["joint_id_core", "joint_id_msgs", "joint_id_ros"]
    for tag in ("version", "license", "author", "maintainer"):
        (said,) = {text(package, tag) for package in PACKAGES}
        assert said, tag
    (address,) = {manifest(package).findall("maintainer")[0].get("email") or "" for package in PACKAGES}
    assert re.fullmatch(r"\S+@\S+\.\S+", address)
    assert "Apache License" in (ROOT / "LICENSE").read_text() and text(PACKAGES[0], "license") == "Apache-2.0"


def test_where_the_packages_are_hosted_is_said_everywhere_or_nowhere() -> None:
    """Once a host is known, it stands in CITATION.cff and in every manifest, and the declaration says so no longer."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    known = {citation[k] for k in ("url", "repository-code") if k in citation}
    for package in PACKAGES:
        assert {url.text for url in manifest(package).findall("url")} == known, package.name
    said = "no public host is known yet" in " ".join((ROOT / "QUALITY_DECLARATION.md").read_text().split())
    assert said == (not known)


@pytest.mark.parametrize("package", IN_PYTHON, ids=lambda p: p.name)
def test_setup_says_what_the_manifest_says(package: Path) -> None:
    said = setup_arguments(package)
    for tag in SAME:
        assert said[tag] == text(package, tag), tag
    assert said["maintainer_email"] == manifest(package).findall("maintainer")[0].get("email")
    needed = {n.split(">")[0] for n in said["install_requires"]} - NOT_IN_APT
    declared = {d.text.removeprefix("python3-") for d in manifest(package).findall("exec_depend") if d.text}
    assert {n.replace("pyyaml", "yaml") for n in needed} <= declared


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.name)
def test_rosdoc2_finds_its_settings_and_a_first_page(package: Path) -> None:
    assert text(package, "export/rosdoc2") == "rosdoc2.yaml"
    head, settings = yaml.safe_load_all((package / "rosdoc2.yaml").read_text())
    assert head == {"type": "rosdoc2 config", "version": 1}
    assert settings["builders"] == [{"sphinx": {"name": package.name, "output_dir": ""}}]
    assert (package / "doc/index.rst").read_text().startswith(package.name)
