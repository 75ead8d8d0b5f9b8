"""README is short, and its figures and commands are those of the project."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from limberjack import policies

_REPOSITORY = Path(__file__).parents[2]
_README = _REPOSITORY / "README.md"
_RESULTS = _REPOSITORY / "benchmarks" / "results"
_MOST_WORDS = 700  # so that it is read in two minutes
_MOST_BYTES = 4_000_000  # of its pictures
_LIMIT = 600  # seconds, to build and install on the slowest machine


def _text() -> str:
    """README with its line breaks as blanks."""
    return " ".join(_README.read_text(encoding="utf-8").split())


def test_the_readme_is_short() -> None:
    assert len(_text().split()) <= _MOST_WORDS


def test_the_readme_has_one_moving_picture_by_a_relative_link_that_loads_quickly() -> None:
    (picture,) = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", _text())
    path = _REPOSITORY / picture
    assert path.suffix == ".gif"
    assert path.stat().st_size <= _MOST_BYTES


def test_the_readme_names_the_targets_that_users_call() -> None:
    for target in ("make demo", "make docs", "make test"):
        assert f"`{target}`" in _text()


def test_the_comparisons_in_the_readme_are_those_of_the_long_comparison() -> None:
    results = json.loads((_RESULTS / "exactness.json").read_text(encoding="utf-8"))
    told = f"{results['differences']} differences in {results['comparisons']:,} comparisons"
    assert told in _text()


def test_the_policies_that_the_readme_counts_are_the_bundled_ones() -> None:
    bundled = {(one.domain, one.task) for one in policies.bundled()}
    assert f"the mean returns of the {len(bundled)} bundled policies only within noise" in _text()
    assert f"{len(bundled)} tasks have a bundled policy" in _text()
    assert "MuJoCo 2.3.7 and 3.17 change" in _text()


def test_the_shifts_of_bundled_policies_that_exceed_noise_are_told() -> None:
    page = " ".join((_REPOSITORY / "docs" / "bridge.md").read_text(encoding="utf-8").split())
    verdicts = re.findall(r"on MuJoCo ([\d.]+)\.\*\* (The bundled policies: .*?)The widest", page)
    assert [version for version, _ in verdicts] == ["3.17.0", "2.3.7"]
    for version, verdict in verdicts:
        if "shifted" in verdict:
            for task, shift in re.findall(r"(\w+ \w+) [+-]([\d.]+) \(", verdict):
                told = f"that of {task} shifts by {float(shift):.0f} of 1,000 on MuJoCo {version}"
                assert told in _text()
        else:
            assert "no difference beyond noise on all" in verdict


def test_the_cost_of_python_in_the_readme_is_the_one_that_was_measured() -> None:
    rows = json.loads((_RESULTS / "suite_speed.json").read_text(encoding="utf-8"))["rows"]
    slowest = min(
        row["value"]
        for row in rows
        if row["measure"] == "batch / bare Batch"
        and row["subject"].endswith(", N=64")
        and row["details"].get("class") == "toy"
    )
    assert f"Python costs up to {100 * (1 - slowest):.0f} % (" in _text()


def test_the_lines_that_need_no_clone_are_the_same_on_both_pages() -> None:
    install = (_REPOSITORY / "docs" / "install.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^ +(uvx .*)$", _README.read_text(encoding="utf-8"), re.MULTILINE)
    assert line in install
    assert line.replace("uvx --from", "pipx run --spec") in install


@pytest.mark.slow
@pytest.mark.parametrize("program", ["uvx", "pipx"])
def test_the_line_that_needs_no_clone_plays_a_policy(program: str, tmp_path: Path) -> None:
    if shutil.which(program) is None:
        # They install packages by themselves, and are not Limberjack's to install.
        pytest.skip(f"there is no {program} here: install it to test README's line")
    page = (_REPOSITORY / "docs" / "install.md").read_text(encoding="utf-8")
    (line,) = re.findall(rf"^ +({program} .*)$", page, re.MULTILINE)
    here = line.replace("git+URL", f"git+{_REPOSITORY.as_uri()}")
    done = subprocess.run(
        here.split(), cwd=tmp_path, capture_output=True, text=True, timeout=_LIMIT, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^ +0 +9\d\d\.\d+ +1000 *$", done.stdout, re.MULTILINE), done.stdout
