"""The output of `limberjack solve --explain`."""

from pathlib import Path

from typer.testing import CliRunner

from limberjack.cli import app


def test_solve_explains_its_plans_by_stage_and_terms(tmp_path: Path) -> None:
    tower = ["solve", "stacker", "stack_2", "--time-limit", "0.03", "--threads", "1", "--explain"]
    result = CliRunner().invoke(app, [*tower, "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    first = result.stdout.splitlines()[0]
    assert first.startswith("  0.00 s  wait beside falling boxes: reward ")
    assert "falling boxes" in first.split(": ", 1)[1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    plans = page.partition("Plans of the first episode")[2]
    assert "falling boxes" in plans
    assert "wait beside falling boxes</td>" in plans
