"""The domain of docs/adding_a_domain.md works everywhere as an installed package.

Pip installs it into a virtual environment of its own.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import limberjack
from tests import tutorial
from tests.programs import run

_TESTS = Path(__file__).parent
_SOURCE = Path(limberjack.__file__).parents[1]
_ID = "my_package.swing:limberjack/swing-swing_up-v0"


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of the environment in which the package is installed."""
    return tutorial.environment(tmp_path_factory.mktemp("installed"))


def _call(python: Path, *command: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    """The result of a module that the interpreter runs as a program."""
    inherited = {name: value for name, value in os.environ.items() if "COLOR" not in name}
    return subprocess.run(
        [python, "-m", *command],
        cwd=_TESTS.parent,
        env=inherited | variables,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def _limberjack(python: Path, *arguments: str, **variables: str) -> str:
    done = _call(python, "limberjack", *arguments, **variables)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_passes_all_laws(python: Path) -> None:
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-rs"]
    done = _call(python, "pytest", "tests/laws", *options, LAWS_OF=tutorial.DOMAIN)
    assert done.returncode == 0, done.stdout
    skipped = [line for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    assert len(skipped) == 1
    assert "swing_up does not draw starts until they are free of contacts" in skipped[0]


# Runs commands, one after the other, and prints a JSON list of what each has printed.
_COMMANDS = """
import json, sys
from typer.testing import CliRunner
from limberjack.cli import app
done = [CliRunner().invoke(app, arguments) for arguments in json.loads(sys.argv[1])]
failed = [one for one in done if one.exit_code]
assert not failed, (failed, [one.output for one in failed])
print(json.dumps([one.stdout for one in done]))
"""


def test_every_command_takes_it_by_its_entry_point(python: Path, tmp_path: Path) -> None:
    task, short = [tutorial.DOMAIN, tutorial.TASK], ["--time-limit", "0.2"]
    out, solved = str(tmp_path / "evaluation"), str(tmp_path / "solved")
    commands = [
        ["list"],
        ["run", *task, *short, "--policy", "random"],
        ["evaluate", *task, *short, "--episodes", "4", "--out", out],
        ["bench", *task, "--num-envs", "2", "--seconds", "0.1"],
        ["solve", *task, *short, "--threads", "1", "--out", solved],
        ["replay", solved],
    ]
    printed = json.loads(run(_COMMANDS, json.dumps(commands), python=python))
    listed, ran, _, bench, _, replayed = printed
    assert re.search(r"swing +swing_up +easy, extra +1 +3", listed)
    assert any(kind in ran for kind in ("above", "below"))
    result = json.loads((tmp_path / "evaluation" / "result.json").read_text())
    assert {episode["start"] for episode in result["episodes"]} <= {"above", "below"}
    assert "for 2 environments" in bench
    assert "every bit the same" in replayed


def test_commands_take_a_module_that_registers(tmp_path: Path) -> None:
    # On the path of this process's interpreter, without an entry point.
    tutorial.install(tmp_path, with_entry_point=False)
    places = [str(tmp_path), str(_SOURCE), os.environ.get("PYTHONPATH")]
    python, path = Path(sys.executable), os.pathsep.join(filter(None, places))
    run_it = ["run", tutorial.DOMAIN, tutorial.TASK, "--time-limit", "0.1"]
    refused = _call(python, "limberjack", *run_it, PYTHONPATH=path)
    assert refused.returncode == 2
    assert "Domain 'swing' does not exist" in refused.stderr
    imported = ["--import", tutorial.MODULE]
    ran = _limberjack(python, *imported, *run_it, "--seeds", "1", PYTHONPATH=path)
    assert "above" in ran
    assert "swing_up" in _limberjack(python, *imported, "list", PYTHONPATH=path)


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("no_such_module", "--import no_such_module: No module named 'no_such_module'"),
        ("colorsys", "--import colorsys: the module registers no domain; write suite.register"),
    ],
)
def test_a_module_that_registers_nothing_is_status_2(
    python: Path, module: str, message: str
) -> None:
    done = _call(python, "limberjack", "--import", module, "list")
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_gymnasiums_checker_has_nothing_to_say(python: Path) -> None:
    run(
        f"""
        import gymnasium
        from gymnasium.utils.env_checker import check_env
        env = gymnasium.make({_ID!r}, flat=True)
        assert env.spec.max_episode_steps == 500
        check_env(env.unwrapped, skip_render_check=True)
        """,
        python=python,
    )


def test_spawned_processes_know_it(python: Path) -> None:
    printed = run(
        f"""
        import gymnasium
        import numpy as np
        if __name__ == "__main__":
            name, args = {_ID!r}, {{"num_envs": 2, "flat": True}}
            one = gymnasium.make_vec(name, vectorization_mode="vector_entry_point", **args)
            other = gymnasium.make_vec(
                name, vectorization_mode="async", vector_kwargs={{"context": "spawn"}}, **args
            )
            first, _ = one.reset(seed=3)
            second, _ = other.reset(seed=3)
            assert np.array_equal(first, second)
            for _ in range(3):
                actions = np.full((2, 1), 0.3)
                assert np.array_equal(one.step(actions)[0], other.step(actions)[0])
            other.close()
            print(first.shape)
        """,
        python=python,
    )
    assert printed == "(2, 3)\n"


def test_a_spec_from_another_process_makes_it(python: Path) -> None:
    spec = run(
        f"import gymnasium; print(gymnasium.make({_ID!r}, max_episode_steps=9).spec.to_json())",
        python=python,
    )
    printed = run(
        """
        import sys
        import gymnasium
        from gymnasium.envs.registration import EnvSpec
        env = gymnasium.make(EnvSpec.from_json(sys.argv[1]))
        env.reset(seed=0)
        steps = 1
        while not env.step(env.action_space.sample())[3]:
            steps += 1
        print(steps)
        """,
        spec,
        python=python,
    )
    assert printed == "9\n"


def test_python_evaluates_plans_and_draws_it(python: Path, drawing: bool) -> None:
    printed = run(
        """
        import sys
        import numpy as np
        from limberjack import gallery, suite
        from limberjack.evaluation import evaluate
        from limberjack.planner import Planner, cost_for

        score = evaluate("swing", "swing_up", "random", range(4), time_limit=0.2)
        assert set(score.strata()) <= {"above", "below"}
        env = suite.load("swing", "swing_up", {"random": 0, "time_limit": 5.0})
        assert type(cost_for(env.task)).__module__ == "my_package.swing_cost"
        planner = Planner(env, num_threads=1, seed=0)
        time_step, total = env.reset(), 0.0
        while not time_step.last():
            time_step = env.step(planner.act())
            total += time_step.reward
        assert total > 100, total
        if sys.argv[1] == "True":
            assert gallery.draw("swing", "swing_up", 60, 80).std() > 5
        print("done")
        """,
        str(drawing),
        python=python,
    )
    assert printed == "done\n"
