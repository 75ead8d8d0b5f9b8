"""Tables of returns."""

from limberjack.cli.output import console
from limberjack.cli.summaries import add_summaries, summaries_table
from limberjack.episodes.statistics import Score, strata, summarise


def test_a_row_for_all_episodes_is_followed_by_one_for_each_start() -> None:
    scores = [Score(seed, 10.0 + seed, 5, float(seed), start=f"kind_{seed}") for seed in range(2)]
    rows = summaries_table("policy")
    add_summaries(rows, "zero", summarise(scores), strata(scores))
    screen = console()
    with screen.capture() as captured:
        screen.print(rows)
    shown = captured.get().splitlines()
    lines = [line.split() for line in shown if "kind_" in line or "zero" in line]
    assert lines[0][:3] == ["zero", "2", "10.5"]
    assert lines[0][-2:] == ["50.0", "%"]
    assert lines[1] == ["kind_0", "1", "10.0", "10.0", "0.0", "%"]
    assert lines[2] == ["kind_1", "1", "11.0", "11.0", "100.0", "%"]
