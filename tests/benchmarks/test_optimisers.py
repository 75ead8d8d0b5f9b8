"""The comparison of optimisers resumes, and reports on the seeds that all variants have played."""

import json
from pathlib import Path
from typing import Any

import optimisers
import pytest
import typer

from limberjack.planner import ICEM, MPPI, Settings


def test_an_episode_is_kept_as_it_ends_and_is_not_played_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def play() -> str:
        variants = ["icem samples=12"]
        optimisers.main("pendulum:swingup", variants, seeds=2, seconds=0.06, file=file)
        return capsys.readouterr().out

    file = tmp_path / "optimisers.json"
    assert play().count("pendulum:swingup, 0.06 s 100") == 4
    (entry,) = json.loads(file.read_text(encoding="utf-8")).values()
    assert list(entry["variants"]) == ["own", "icem samples=12"]
    played = entry["variants"]["icem samples=12"]
    assert played["samples"] == 12
    assert [one["steps"] for one in played["episodes"].values()] == [3, 3]
    del played["episodes"]["1001"]  # as if it had been killed
    file.write_text(json.dumps({"pendulum:swingup, 0.06 s": entry}))
    again = play()
    assert again.count("pendulum:swingup, 0.06 s 100") == 1
    assert "| 2 seeds | samples |" in again
    entry["planner"] = "0" * 64
    file.write_text(json.dumps({"pendulum:swingup, 0.06 s": entry}))
    with pytest.raises(typer.BadParameter, match="was played with other sources of the planner"):
        play()


def test_a_variant_without_samples_takes_as_much_time_as_the_own_settings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(optimisers, "_PLANS", 4)
    monkeypatch.setattr(optimisers, "_ROUNDS", 2)
    own = Settings(samples=8, horizon=0.1)
    found = optimisers._equal("walker", "run", own, Settings(samples=128, horizon=0.1))
    assert 8 <= found.samples < 64


def test_words_describe_settings() -> None:
    own = Settings(samples=10, noise=0.3)
    assert optimisers.settings_of(own, "own") is own
    found = optimisers.settings_of(own, "icem colour=0.5 takes_best=true samples=7")
    assert found == Settings(samples=7, noise=0.3, optimiser=ICEM(colour=0.5, takes_best=True))
    assert optimisers.settings_of(own, "mppi iterations=2").optimiser == MPPI(iterations=2)
    for variant in optimisers.VARIANTS:
        optimisers.settings_of(own, variant)


@pytest.mark.parametrize(
    ("variant", "message"),
    [
        ("ices", "optimiser is 'ices'; expected own, mppi or icem. Did you mean 'icem'"),
        ("mppi elites=3", "mppi has no option 'elites'; it has iterations, colour, finest, temp"),
        ("icem iterations=0", "iterations is 0; expected a whole number from 1"),
    ],
)
def test_a_variant_that_cannot_be_is_named(variant: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        optimisers.settings_of(Settings(), variant)


def test_the_table_compares_seeds_that_all_have_played() -> None:
    def of(*returns: float) -> dict[str, Any]:
        episodes = {
            str(seed): {"return": value, "steps": 10, "processor_seconds": 2.0}
            for seed, value in enumerate(returns)
        }
        return {"samples": 8, "episodes": episodes}

    entry = {"variants": {"own": of(1.0, 2.0, 9.0), "icem": of(2.0, 4.0)}}
    lines = optimisers.table(entry)
    assert lines[0].startswith("| 2 seeds |")
    assert lines[2] == "| own | 8 | 0.150 |  | 1.00 |"
    # Differences of 0.1 and 0.2: a standard error of 0.05.
    assert lines[3] == "| icem | 8 | 0.300 | +0.150 ± 0.098 | 1.00 |"
    entry["variants"]["icem"]["episodes"] = {}
    assert len(optimisers.table(entry)) == 2


def test_the_page_has_the_table_of_the_results() -> None:
    found = json.loads(optimisers.RESULTS.read_text(encoding="utf-8"))
    page = (Path(__file__).parents[2] / "docs" / "planner.md").read_text(encoding="utf-8")
    for entry in found.values():
        assert "\n".join(optimisers.table(entry)) in page
