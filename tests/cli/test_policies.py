"""`limberjack policies` and `export`, and the bundled policies in the commands that play.

tests/policies/test_exporting.py exports models.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from limberjack.policies import mlp
from tests.policies.network_files import bundle, write

from .conftest import invoke


def test_an_empty_table_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundle(monkeypatch, tmp_path)
    result = invoke("policies")
    expected = "No task has a bundled policy in this version.\n"
    assert (result.exit_code, result.stdout) == (0, expected)
    assert json.loads(invoke("policies", "--json").stdout) == []


def test_each_bundled_policy_has_a_row_with_its_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"))
    path = tmp_path / "cheetah-run.safetensors"
    write(path, "cheetah", "run", scores=None, algorithm="", steps=300_000)
    result = invoke("policies")
    assert result.exit_code == 0
    head, _, first, second = result.stdout.splitlines()
    assert " ".join(head.split()) == (
        "domain task algorithm repeat steps mean 95 % interval seeds kB"
    )
    nbytes = path.stat().st_size
    figures = ["2", "300,000", "-", "-", "-", f"{nbytes / 1e3:.0f}"]
    assert first.split() == ["cheetah", "run", "-", *figures]
    scores = ["500.5", "450.0", "to", "550.0", "1000:1100"]
    assert second.split() == ["walker", "walk", "CrossQ", "2", "-", *scores, "3"]


def test_the_json_list_has_the_cards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"))
    (one,) = json.loads(invoke("policies", "--json").stdout)
    policy = mlp.load(one["path"])
    assert mlp.Card.of_json(one["card"]) == policy.card
    assert (one["domain"], one["task"]) == ("walker", "walk")
    assert one["nbytes"] == Path(one["path"]).stat().st_size
    assert re.fullmatch("[0-9a-f]{64}", one["sha256"])


def test_a_damaged_bundled_policy_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path)
    (tmp_path / "walker-walk.safetensors").write_text("cut")
    result = invoke("policies")
    assert result.exit_code == 2
    assert re.fullmatch(r"limberjack: .*walker-walk\.safetensors cannot be .*\n", result.stderr)


def test_a_task_without_a_bundled_policy_is_a_mistake_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"))
    for command in ("run", "evaluate", "view", "collect", "record"):
        out = {
            "collect": ["--out", str(tmp_path / "o")],
            "record": ["--out", str(tmp_path / "o.gif")],
        }
        result = invoke(command, "cheetah", "run", "--policy", "pretrained", *out.get(command, []))
        assert result.exit_code == 2
        assert result.stderr == (
            "limberjack: policy 'pretrained': cheetah run has none; these tasks have one: "
            "walker walk\n"
        )


def test_each_command_obeys_the_repeat_of_the_policy(tmp_path: Path) -> None:
    name = write(tmp_path / "walk.safetensors")
    for command, *more in (
        ["run"],
        ["evaluate"],
        ["collect", "--out", str(tmp_path / "data")],
        ["record", "--out", str(tmp_path / "film.gif")],
    ):
        for repeat in ("1", "3"):
            arguments = ["walker", "walk", "--policy", name, *more, "--action-repeat", repeat]
            result = invoke(command, *arguments)
            assert result.exit_code == 2
            assert result.stderr == (
                f"limberjack: action_repeat is {repeat}, but policy {name!r} acts every 2 control "
                "steps: leave it out, or set it to 2\n"
            )
    limit = ["--time-limit", "0.1"]
    plain = invoke("run", "walker", "walk", "--policy", name, *limit)
    asked = invoke("run", "walker", "walk", "--policy", name, *limit, "--action-repeat", "2")
    assert plain.exit_code == asked.exit_code == 0
    assert plain.stdout == asked.stdout


def test_scores_of_another_task_are_one_line(tmp_path: Path) -> None:
    name = write(tmp_path / "walk.safetensors")
    line = f"limberjack: policy {name!r}: its scores are those of walker walk\n"
    for command, *more in (
        ["run", "--time-limit", "0.1"],
        ["evaluate", "--time-limit", "0.1", "--episodes", "1"],
        ["record", "--seconds", "0.1", "--out", str(tmp_path / "film.gif")],
    ):
        result = invoke(command, "walker", "run", "--policy", name, *more)
        assert result.exit_code == 0, result.stderr
        assert result.stderr.count(line) == 1


def test_a_network_is_no_code_and_gets_no_warning(tmp_path: Path) -> None:
    name = write(tmp_path / "walk.safetensors")
    result = invoke("run", "walker", "walk", "--policy", name, "--time-limit", "0.1")
    assert "pickle" not in result.stderr
    assert result.exit_code == 0


def test_mistakes_are_one_line_and_write_nothing(tmp_path: Path) -> None:
    out = str(tmp_path / "out.safetensors")
    for arguments, message in (
        (["random"], "policy is 'random'; expected sb3:PATH, a model to export"),
        (["sb3:none.zip", "--task", "walker"], "got walker without a task; choose one of: run,"),
        (["sb3:none.zip", "--task", "walker/wlak"], "Did you mean 'walk'?"),
        (["sb3:none.zip"], "policy 'sb3:none.zip': "),
    ):
        result = invoke("export", arguments[0], out, *arguments[1:])
        assert result.exit_code == 2
        assert message in result.stderr
        assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("ending", "kind"), [("safetensors", "mlp"), ("onnx", "onnx")])
def test_an_exported_policy_is_named_by_the_kind_of_its_file(
    ending: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.policies.exporting.export", lambda *given, **how: None)
    result = invoke("export", "sb3:walk.zip", f"walk.{ending}")
    assert result.stdout == f"walk.{ending}: --policy {kind}:walk.{ending}\n"


def test_an_exported_model_is_played_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baselines: Any = pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    sb3: Any = pytest.importorskip("limberjack.sb3", reason="needs the extra 'sb3'")
    monkeypatch.setitem(sys.modules, "gym", None)  # SB3 looks for it, and finds a folder of tests
    envs = sb3.make_vec_env("walker", "walk", 2, seed=0, num_threads=1)
    baselines.PPO("MlpPolicy", envs, device="cpu", n_steps=8, batch_size=16).save(
        tmp_path / "m.zip"
    )
    name, out = f"sb3:{tmp_path / 'm.zip'}", tmp_path / "of mine.safetensors"
    arguments = ["--task", "walker/walk", "--action-repeat", "2"]
    result = invoke("export", name, str(out), *arguments)
    assert (result.exit_code, result.stdout) == (0, f"{out}: --policy 'mlp:{out}'\n")
    assert result.stderr.startswith(f"limberjack: policy {name!r} is a pickle, and loading it runs")
    assert mlp.load(out).card.title == "walker walk"
    played = invoke("run", "walker", "walk", "--policy", f"mlp:{out}", "--time-limit", "0.1")
    assert played.exit_code == 0, played.stderr
