"""The card of a dataset, and the hashes that it lists."""

from pathlib import Path

import bring_ball_dataset
import pytest

from limberjack import data


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Collects short episodes of random actions in the place of the planner's."""
    collect = data.collect

    def short(domain: str, task: str, policy: str, seeds: range, **kwargs: object) -> None:
        assert policy == "planner"
        out = str(kwargs["out"])
        collect(domain, task, "random", seeds, out=out, time_limit=0.05, num_threads=1)

    monkeypatch.setattr(data, "collect", short)


@pytest.mark.usefixtures("quick")
def test_a_second_run_reproduces_the_hashes_of_the_card(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bring_ball_dataset.main(tmp_path / "one", episodes=2)
    card = tmp_path / "one" / "CARD.md"
    text = card.read_text(encoding="utf-8")
    files = data.inform(data.load(tmp_path / "one")).files
    assert bring_ball_dataset.hashes_in(text) == files
    for part in ("licence | Apache", "| all | 2 |", "--policy planner --seeds 0:2", "mujoco "):
        assert part in text
    bring_ball_dataset.main(tmp_path / "two", episodes=2, compare=card)
    with pytest.raises(SystemExit) as caught:
        bring_ball_dataset.main(tmp_path / "three", episodes=1, compare=card)
    assert caught.value.code == 1
    assert "other hashes than in" in capsys.readouterr().err
