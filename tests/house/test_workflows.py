"""What GitHub reads of the repository: workflows, updates, forms."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
TARGETS = set(
    re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflow_jobs_targets_and_permissions(path: Path):
    text = path.read_text(encoding="utf-8")
    workflow = yaml.safe_load(text)
    for name, job in workflow["jobs"].items():
        assert job["runs-on"], name
        needed = job.get("needs", [])
        needed = {needed} if isinstance(needed, str) else set(needed)
        assert needed <= set(workflow["jobs"])
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step), f"{path.name}, {name}: {step}"
    for target in re.findall(r"run: make ([a-z-]+)", text):
        assert target in TARGETS, target
    # What may be written is named by the job that writes it.
    assert workflow["permissions"] == {"contents": "read"}


def test_release_artefacts_downloaded_equal_built():
    jobs = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text())["jobs"]
    built = {
        "-".join((item["os"], item["target"], item["manylinux"]))
        for item in jobs["wheels"]["strategy"]["matrix"]["include"]
    }
    tried = {
        item["wheel"]
        for job in ("installed", "installed-musl")
        for item in jobs[job]["strategy"]["matrix"]["include"]
    }
    assert tried == built


def test_dependabot_directories_of_manifests():
    manifests = {
        "cargo": "Cargo.toml",
        "pip": "pyproject.toml",
        "npm": "package.json",
        "github-actions": ".github/workflows/ci.yml",
    }
    updates = yaml.safe_load((ROOT / ".github/dependabot.yml").read_text())["updates"]
    assert {item["package-ecosystem"] for item in updates} == set(manifests)
    for item in updates:
        folder = ROOT / item["directory"].strip("/")
        assert (folder / manifests[item["package-ecosystem"]]).is_file(), item


@pytest.mark.parametrize("page", ["SECURITY.md", "CODE_OF_CONDUCT.md"])
def test_community_page_links_point_to_files(page: str):
    text = (ROOT / page).read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#\s]+)", text)
    assert targets
    for target in targets:
        assert (ROOT / target).is_file(), target
