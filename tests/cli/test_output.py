"""Tables, complaints and exit statuses of commands."""

import re
import sys
from pathlib import Path

import pytest
import typer

from limberjack import policies
from limberjack.cli import output
from limberjack.cli.output import add_summaries, console, summaries_table
from limberjack.episodes.manifest import DamagedError
from limberjack.episodes.statistics import Score, strata, summarise
from limberjack.policies.kinds import Locating, PolicyError
from limberjack.policies.saved import read_model
from limberjack.rl.batches import NOT_VECTORISED
from limberjack.rl.control import PhysicsError
from limberjack.utils.log import log
from limberjack.workers import WorkError


def _printed(table: object, capsys: pytest.CaptureFixture[str]) -> list[str]:
    output.console().print(table)
    return [line for line in capsys.readouterr().out.splitlines() if line.strip()]


def test_columns_are_aligned_as_their_names_say(capsys: pytest.CaptureFixture[str]) -> None:
    rows = output.table("task", "return>")
    rows.add_row("walk", "7.0")
    rows.add_row("a longer name", "123.0")
    lines = _printed(rows, capsys)
    assert lines[0].split() == ["task", "return"]
    assert lines[-2].endswith("  7.0 ")
    assert lines[-1].startswith(" a longer name ") or lines[-1].startswith("a longer name ")


def test_without_a_terminal_a_long_row_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    rows = output.table("what")
    rows.add_row("x" * 150)
    assert "x" * 150 in _printed(rows, capsys)[-1]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("no such\n  task"), "no such task"),
        (FileNotFoundError(2, "no file", "a.toml"), "no file: 'a.toml'"),
        (ValueError("--config: [Errno 13] no access"), "--config: no access"),
    ],
)
def test_an_error_in_the_arguments_is_one_line_and_status_2(
    error: Exception, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as end, output.misuse_reported():
        raise error
    assert end.value.exit_code == output.MISUSED
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"limberjack: {text}\n"


def test_an_error_of_the_program_itself_is_not_hidden() -> None:
    with pytest.raises(KeyError), output.misuse_reported():
        raise KeyError("bug")


def test_exit_statuses_are_those_of_shells() -> None:
    assert (output.FAILED, output.MISUSED) == (1, 2)
    assert (output.INTERRUPTED, output.TERMINATED) == (128 + 2, 128 + 15)


def test_a_policy_is_found_in_the_working_directory_of_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "policy_of_a_test.py").write_text("def act(observation):\n    return [0.0]\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    for policy in ("zero", "sb3:walk.zip", "mlp:walk.safetensors"):
        output.search_working_directory(policy)
    assert str(tmp_path) not in sys.path
    for _ in range(2):
        output.search_working_directory("policy_of_a_test:act")
    assert sys.path.count(str(tmp_path)) == 1
    assert sys.path[-1] == str(tmp_path)
    assert policies.find("policy_of_a_test:act").name == "policy_of_a_test:act"
    sys.modules.pop("policy_of_a_test", None)


class _Begun:
    """Progress of a command; None before its first episode has begun."""

    def __init__(self, finished: int | None) -> None:
        self.finished = finished


def _failed(error: BaseException, finished: int | None) -> int:
    """The exit status after an error."""
    with (
        pytest.raises(typer.Exit) as end,
        output.failures_reported(_Begun(finished), lambda: "2 of 3 finished"),
    ):
        raise error
    return end.value.exit_code


def _located(error: Exception) -> Exception:
    error.add_note("policy 'a:b'")
    return error


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (PolicyError("nan"), "nan"),
        (PhysicsError("it diverged"), "it diverged"),
        (WorkError("a worker died"), "a worker died"),
        (OSError("disk full"), "disk full"),
        (_located(KeyError("x")), "policy 'a:b': KeyError: 'x'"),
    ],
)
def test_a_failure_is_a_mistake_until_an_episode_has_begun(
    error: Exception, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _failed(error, None) == output.MISUSED
    line = f"limberjack: {sentence}( \\(.*, line \\d+, in _failed\\))?"
    assert re.fullmatch(f"{line}\n", capsys.readouterr().err)
    assert _failed(error, 0) == output.FAILED
    assert re.fullmatch(f"{line}; 2 of 3 finished\n", capsys.readouterr().err)


def test_a_failure_that_would_recur_comes_without_the_advice_to_continue(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert _failed(DamagedError("a file is damaged"), 2) == output.FAILED
    assert capsys.readouterr().err == "limberjack: a file is damaged\n"


def test_an_interrupt_has_its_status_and_the_number_of_episodes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for finished in (None, 2):
        assert _failed(KeyboardInterrupt(), finished) == output.INTERRUPTED
        assert capsys.readouterr().err == "limberjack: interrupted: 2 of 3 finished\n"


def test_an_unexpected_error_keeps_its_traceback_and_says_what_is_finished(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(output, "users_failure", lambda error: None)  # as for the package's own
    for finished, notes in ((None, []), (2, ["limberjack: 2 of 3 finished"])):
        with (
            pytest.raises(KeyError) as caught,
            output.failures_reported(_Begun(finished), lambda: "2 of 3 finished"),
        ):
            raise KeyError("bug")
        assert getattr(caught.value, "__notes__", []) == notes


def test_the_reason_for_complete_environments_is_printed_once_in_the_end(
    capsys: pytest.CaptureFixture[str],
) -> None:
    level = log.level
    with output.remarks_reported():
        for reason in ("a stream", "a stream", "a step"):
            log.info(NOT_VECTORISED, reason)
        log.info("something else")
        assert capsys.readouterr().err == ""
    assert log.level == level
    reasons = [f"limberjack: {NOT_VECTORISED % one}\n" for one in ("a stream", "a step")]
    assert capsys.readouterr().err == "".join(reasons)


def test_names_that_look_like_markup_are_shown_as_they_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = output.table("policy")
    rows.add_row("sb3:[/red][bold]x :heart: .zip")
    assert "sb3:[/red][bold]x :heart: .zip" in _printed(rows, capsys)[-1]


def test_what_a_terminal_would_obey_is_shown_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    output.complain("a\x1b[2J title\x07 of a dataset\N{RIGHT-TO-LEFT OVERRIDE}, 40 N·m")
    expected = "limberjack: a\\x1b[2J title\\x07 of a dataset\\u202e, 40 N·m\n"
    assert capsys.readouterr().err == expected


def test_an_error_is_shown_after_its_notes(capsys: pytest.CaptureFixture[str]) -> None:
    error = FileNotFoundError("no weights")
    error.add_note("policy 'a:b', step 3 of the episode with seed 4")
    output.complain(error)
    where = "limberjack: policy 'a:b', step 3 of the episode with seed 4: "
    assert capsys.readouterr().err == f"{where}FileNotFoundError: no weights\n"
    own = PolicyError("nan")  # whose message needs nothing more
    own.add_note("policy 'a:b'")
    output.complain(own)
    assert capsys.readouterr().err == "limberjack: policy 'a:b': nan\n"


def test_an_error_of_a_policys_module_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(typer.Exit) as caught, output.misuse_reported(), Locating("policy 'a:b'"):
        raise NameError("no such\nname")
    assert caught.value.exit_code == 2
    error = capsys.readouterr().err
    assert error.startswith("limberjack: policy 'a:b': NameError: no such name (")
    assert error.count("\n") == 1


def test_only_errors_of_a_users_code_have_a_sentence() -> None:
    assert output.users_failure(KeyError("x")) is None
    assert output.users_failure(KeyboardInterrupt()) is None
    error = KeyError("x")
    error.add_note("policy 'a:b'")
    assert output.users_failure(error) == "policy 'a:b': KeyError: 'x'"
    with pytest.raises(KeyError) as caught:
        raise KeyError("x")  # here, which is no code of the package
    sentence = output.users_failure(caught.value)
    assert sentence is not None
    assert sentence.startswith("KeyError: 'x' (")


def test_a_working_directory_that_was_removed_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    before = list(sys.path)
    output.append_working_directory()
    assert sys.path == before


def test_a_stream_that_was_closed_before_the_start_is_no_terminal() -> None:
    assert not output.is_terminal(None)


def test_the_first_saved_model_is_called_code_as_its_files_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with output.remarks_reported():
        with pytest.raises(policies.PolicyError):
            read_model("sb3:walk")
        assert capsys.readouterr().err == ""
        (tmp_path / "walk.zip").touch()
        for _ in range(2):
            read_model("sb3:walk")
        assert capsys.readouterr().err == (
            "limberjack: policy 'sb3:walk' is a pickle, and loading it runs the Python code in it: "
            "use only files of people whom you trust\n"
        )
    assert capsys.readouterr().err == ""


def test_a_row_for_all_episodes_is_followed_by_one_for_each_start() -> None:
    scores = [Score(seed, 10.0 + seed, 5, float(seed), start=f"kind_{seed}") for seed in range(2)]
    rows = summaries_table()
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
