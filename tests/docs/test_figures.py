"""Figures and names in documents are those of the code."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

import runtime
from runtime import Limits, Planner, Sizes
from runtime.network.reader import chunk_samples

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MANIFEST = Planner().bundle.manifest


def test_version_is_the_same_everywhere() -> None:
    version = runtime.__version__
    assert re.search(rf"^## \[(Unreleased|{re.escape(version)})\]", read("CHANGELOG.md"), flags=re.MULTILINE)
    assert yaml.safe_load(read("CITATION.cff"))["version"] == version
    for path in ("docs/guide/start.md", "docs/guide/deploy.md", "docs/kubernetes/slide-planner.yaml"):
        named = set(re.findall(r"slide[-_]planner[-:](\d+\.\d+\.\d+)", read(path)))
        assert named == {version}, path


def test_sizes_of_pan_and_object_are_the_default_ones() -> None:
    sizes = Sizes()
    for text in (README, read("docs/guide/start.md")):
        assert f"a disc with a radius of {sizes.pan_radius:g} m" in flat(text)
        assert f"one with a radius of {sizes.object_radius:g} m" in flat(text)


def test_limits_of_the_readme_are_the_default_ones() -> None:
    limits = Limits()
    assert f"within {limits.pan_reach:g} m of its start" in flat(README)
    assert f"by at most {limits.acceleration:g} m/s²" in flat(README)
    assert f"by at most {limits.jerk:,.0f} m/s³" in flat(README)


def test_what_the_network_knows_is_what_its_manifest_says() -> None:
    known = {name: [f"{bound:g}" for bound in bounds] for name, bounds in MANIFEST.trained_on.items()}
    sentence = flat(README)
    assert f"a reach from {known['pan_reach'][0]} to {known['pan_reach'][1]} m" in sentence
    assert f"an acceleration from {known['acceleration'][0]} to {known['acceleration'][1]} m/s²" in sentence
    assert f"static friction from {known['static'][0]} to {known['static'][1]}" in sentence


def test_figures_of_the_readme_are_those_of_the_results() -> None:
    table = README[README.index("## How good it is") :]
    results = read("docs/results/limits.md")
    rows = {"| default limits": "| default 1/0.5", "| a Panda": "| panda 0.5/0.3", "| an FR3": "| fr3 0.3/0.2"}
    for mine, theirs in rows.items():
        pair = results[results.index(f"{theirs} spline |") :].splitlines()[:2]
        level, lifting = (float(row.split("|")[2]) for row in pair)
        assert cells(table, mine)[1:] == [f"{level:.1f} mm", f"{lifting:.1f} mm"], mine


def test_shipped_network_is_described_as_it_is() -> None:
    page = read("docs/guide/train.md")
    default = re.search(r"\| `default` \| (\d+) units", page)
    assert default is not None
    assert int(default[1]) == MANIFEST.units
    assert f"chunks of C samples ({chunk_samples(Limits())} ms" in flat(read("docs/architecture.md"))


def test_training_configurations_are_described_as_they_are() -> None:
    from train.config import CONFIGURATIONS

    table = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|$", read("docs/guide/train.md"), flags=re.MULTILINE))
    assert set(table) == set(CONFIGURATIONS)
    for name, text in table.items():
        for units in re.findall(r"(\d+) units", text):
            assert int(units) == CONFIGURATIONS[name].units


def test_a_configuration_in_the_guide_is_accepted(tmp_path: Path) -> None:
    from train.config import load_config

    (block,) = re.findall(r"```json\n(.*?)```", read("docs/guide/train.md"), flags=re.DOTALL)
    path = tmp_path / "my_robot.json"
    path.write_text(block, encoding="utf-8")
    assert load_config(str(path)).name == "my_robot"


def test_makefile_has_every_verb_that_is_named() -> None:
    targets = set(re.findall(r"^([a-z-]+):", read("Makefile"), flags=re.MULTILINE))
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")):
        named = set(re.findall(r"(?:^ {4}|`)make ([a-z-]+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE))
        assert named <= targets, path


def test_modules_that_are_run_exist() -> None:
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages()):
        for module in re.findall(r"python -m ([a-z_.]+)", path.read_text(encoding="utf-8")):
            parts = module.split(".")
            assert ROOT.joinpath(*parts).with_suffix(".py").exists() or ROOT.joinpath(*parts, "__main__.py").exists(), (
                module
            )


def test_files_that_are_named_exist() -> None:
    named = r"`((?:runtime|server|train|export|benchmarks|tests|examples|docs)/[\w/.-]*)`"
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages()):
        for file in re.findall(named, path.read_text(encoding="utf-8")):
            assert (ROOT / file).exists(), f"{path.name} names {file}"


def test_files_of_the_makefile_exist() -> None:
    for file in re.findall(r"(?<=\s)(?:tests|examples|docs)/[\w/.-]+", read("Makefile")):
        assert (ROOT / file).exists(), file


def test_sections_of_the_benchmark_are_those_that_are_named() -> None:
    scripts = tomllib.loads(read("pyproject.toml"))["project"]["scripts"]
    assert "slide-bench" in scripts
    sections = {path.stem for path in (ROOT / "benchmarks" / "sections").glob("[a-z]*.py")}
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages()):
        for line in re.findall(r"(?:^ {4}|`)slide-bench((?: [a-z]+)+)", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert set(line.split()) <= sections, f"{path.name}: slide-bench{line}"


@pytest.mark.parametrize("name", ["guide/controller.md"])
def test_python_of_the_guides_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", read(f"docs/{name}"), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        exec(block, {})


def pages() -> list[Path]:
    return sorted(path for path in (ROOT / "docs").rglob("*.md") if path.parent.name != "decisions")


def cells(text: str, beginning: str) -> list[str]:
    """Return the cells of the table row that begins so."""
    (row,) = [line for line in text.splitlines() if line.startswith(beginning)]
    return [cell.strip() for cell in row.strip("|").split("|")]


def read(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def flat(text: str) -> str:
    return " ".join(text.split())
