"""The library has no side effects on its process. Each test runs in a separate Python process."""

import os
import sys
import textwrap
from pathlib import Path

import pytest

from tests.programs import run

_PLAY = """
import numpy as np
from limberjack import suite
from limberjack.rl import control

def play(env, steps=3):
    time_step = env.reset()
    for _ in range(steps):
        time_step = env.step(np.zeros(env.action_spec().shape))
    return time_step

def diverge(env):
    env.physics.data.qvel[:] = np.nan
    try:
        env.step(np.zeros(env.action_spec().shape))
    except control.PhysicsError as error:
        return error
    raise AssertionError("it did not diverge")
"""
_OPENGL = """
import sys
opengl = [name for name in sys.modules if name.split(".")[0] in ("OpenGL", "glfw", "EGL")]
opengl += [name for name in sys.modules if name in ("mujoco.egl", "mujoco.osmesa", "mujoco.glfw")]
assert not opengl, opengl
"""
# The models of a program are compiled in a fifth of the time.
_SMALL_SKY = """
from tests.small_sky import small_sky
sky = small_sky()
sky.__enter__()
"""
_ROOT = Path(__file__).parents[2]
_HAS_FORK = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
_HAS_STATM = pytest.mark.skipif(
    not os.path.exists("/proc/self/statm"), reason="this system does not report the memory in use"
)
_DRAWS = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="there is no off-screen OpenGL"
)


def program(*parts: str) -> str:
    """A program of several texts, each at any indentation."""
    return "\n".join(textwrap.dedent(part) for part in parts)


def test_nothing_is_printed_or_written_and_no_global_state_is_touched(tmp_path: Path) -> None:
    # Diverging included: MuJoCo alone would write MUJOCO_LOG.TXT.
    look = """
    import locale, logging, os, random, signal, sys, threading, warnings
    import gymnasium  # adds a warning filter; `import limberjack` imports it
    import numpy as np
    os.chdir(sys.argv[1])

    def look():
        root = logging.getLogger()
        return {
            "NumPy's stream": str(np.random.get_state()),
            "random's stream": random.getstate(),
            "NumPy's settings": (np.geterr(), np.get_printoptions()),
            "warning filters": list(warnings.filters),
            "showwarning": (warnings.showwarning, sys.excepthook, sys.unraisablehook),
            "signal handlers": [signal.getsignal(number) for number in signal.valid_signals()],
            "working directory": (os.getcwd(), os.listdir()),
            "environment": dict(os.environ),
            "streams": (sys.stdout, sys.stderr),
            "logging": (root.level, list(root.handlers), logging.lastResort),
            "threads": threading.enumerate(),
            "limits": (sys.getrecursionlimit(), sys.getswitchinterval(), sys.gettrace()),
            "locale": locale.setlocale(locale.LC_ALL),
        }

    before = look()
    """
    compare = """
    after = look()
    assert not [name for name in before if after[name] != before[name]], after
    for task in suite.ALL_TASKS:
        env = suite.load(*task)
        env.observation_spec()
        play(env)
        diverge(env)
        env.close()
    after = look()
    assert not [name for name in before if after[name] != before[name]], after
    """
    assert run(program(_SMALL_SKY, look, _PLAY, compare), str(tmp_path), path=_ROOT) == ""
    assert list(tmp_path.iterdir()) == []


def test_warnings_of_mujoco_reach_the_log_and_only_it() -> None:
    body = """
    import io, logging
    stream = io.StringIO()
    logging.basicConfig(stream=stream)
    env = suite.load("humanoid", "walk")
    play(env)
    assert not stream.getvalue()
    diverge(env)
    assert "WARNING:limberjack:Nan, Inf or huge value" in stream.getvalue(), stream.getvalue()
    """
    assert run(program(_PLAY, body)) == ""


@pytest.mark.parametrize("value", ["nonsense", None])
def test_no_opengl_is_imported_by_import_load_reset_and_step(value: str | None) -> None:
    # The variable is read at import. That no task imports OpenGL is looked at without it, and all
    # of them are open at the exit of the process, which is silent.
    tasks = "[('humanoid', 'walk')]" if value else "suite.ALL_TASKS"
    choose = f"""
    import os
    os.environ.pop("MUJOCO_GL", None)
    os.environ.update({{"MUJOCO_GL": {value!r}}} if {value!r} else {{}})
    import limberjack.mujoco
    """
    again = f"""
    envs = [suite.load(*task) for task in {tasks}]
    for env in envs:
        env.observation_spec()
        play(env)
    assert os.environ.get("MUJOCO_GL") == {value!r}
    """
    parts = choose, _SMALL_SKY, _OPENGL, _PLAY, again, _OPENGL
    assert run(program(*parts), path=_ROOT) == ""


def test_exit_with_anything_open_is_silent() -> None:
    body = """
    import atexit, copy

    closed, diverged, still = (suite.load("humanoid", "walk") for _ in range(3))
    for env in (closed, diverged, still):
        play(env)
    closed.close()
    diverge(diverged)
    unfinished_reset = suite.load("humanoid", "walk").physics.reset_context()
    unfinished_reset.__enter__()
    disabled_part = suite.load("humanoid", "walk").physics.model.disable("gravity")
    disabled_part.__enter__()
    circle = suite.load("humanoid", "walk")
    play(circle)
    circle.physics.env, circle.task.physics = circle, circle.physics
    copied = suite.load("stacker", "stack_2")
    play(copied)
    physics = copied.physics
    copies = [physics.copy(), physics.copy(share_model=True), copy.deepcopy(copied)]
    used_at_the_very_end = suite.load("humanoid", "walk")
    play(used_at_the_very_end)
    atexit.register(used_at_the_very_end.close)
    atexit.register(play, used_at_the_very_end)
    """
    assert run(program(_PLAY, body)) == ""


def test_exit_while_daemon_threads_step_is_silent() -> None:
    body = """
    import threading, time
    envs = [suite.load("humanoid", "walk") for _ in range(4)]

    def run(env):
        while True:
            env.step(np.zeros(21))

    for env in envs:
        threading.Thread(target=run, args=[env], daemon=True).start()
    time.sleep(0.3)
    """
    assert run(program(_PLAY, body)) == ""


def test_exit_after_an_interrupted_step_is_prompt() -> None:
    first = """
    import atexit, time
    atexit.register(lambda: print(time.monotonic() - interrupted))  # the last of all to be called
    """
    body = """
    import mujoco

    def interrupt(model, data):
        raise KeyboardInterrupt

    env = suite.load("humanoid", "walk")
    play(env)
    mujoco.mj_step1 = interrupt
    try:
        play(env)
    except KeyboardInterrupt:
        interrupted = time.monotonic()
    """
    assert float(run(program(first, _PLAY, body))) < 1.0


@_DRAWS
def test_exit_after_drawing_is_silent() -> None:
    body = """
    envs = [suite.load(*task) for task in (("humanoid", "walk"), ("stacker", "stack_2"))]
    for env in envs:
        play(env)
        assert env.physics.render(24, 32, camera_id=0).shape == (24, 32, 3)
    envs[0].close()
    """
    assert run(program(_PLAY, body)) == ""


@_HAS_FORK
def test_a_forked_child_has_the_same_future_and_exits_with_status_0() -> None:
    body = """
    import os, pickle, sys
    tasks = ("humanoid", "walk"), ("manipulator", "insert_peg"), ("stacker", "stack_4")
    envs = [suite.load(*task) for task in tasks]
    for env in envs:
        play(env)

    def go_on():
        steps = []
        for task, env in zip(tasks, envs):
            steps += [env.step(np.ones(env.action_spec().shape)) for _ in range(3)]
            steps += [play(env), play(suite.load(*task, {"random": 3}))]
        return pickle.dumps(steps)

    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.write(write, go_on())
        sys.exit(0)  # as any program ends, with the environment open
    told = os.read(read, 1 << 20)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert told == go_on()
    """
    # Python warns of forking beside the threads of NumPy's linear algebra.
    assert run(program(_PLAY, body), warnings="ignore") == ""


def test_an_environment_can_be_sent_to_a_child() -> None:
    body = """
    import multiprocessing, operator
    env = suite.load("manipulator", "bring_ball", {"random": 1})
    play(env)
    for method in multiprocessing.get_all_start_methods():
        with multiprocessing.get_context(method).Pool(1) as pool:
            far = pool.apply(operator.methodcaller("reset"), (env,))
            pool.close()
            pool.join()
        near = env.reset()
        assert far.first()
        assert str(far) == str(near), method
        for name, value in near.observation.items():
            assert value.tobytes() == far.observation[name].tobytes(), (method, name)
    """
    assert run(program(_PLAY, body), warnings="ignore") == ""


_MEMORY = """
import ctypes, gc

# What the C library keeps for later, such as the 12 MB of a dropped model, is not lost.
_trim = getattr(ctypes.CDLL(None), "malloc_trim", lambda unused: None)

def memory():
    gc.collect()
    _trim(0)
    with open("/proc/self/statm") as file:
        # Excludes pages of files, such as libraries, which the system loads and drops at will.
        resident, shared = map(int, file.read().split()[1:3])
    return (resident - shared) * 4096 / 1e6  # megabytes
"""


@_HAS_STATM
def test_a_second_environment_costs_little_memory() -> None:
    body = """
    for task in dict(suite.ALL_TASKS).items():  # the last task of each domain
        first = suite.load(*task)
        first.reset()  # makes the last of what all share
        before = memory()
        others = [suite.load(*task) for _ in range(20)]
        loaded = (memory() - before) / len(others)
        most = 15.0 if task[0] == "lqr" else 1.0  # each has springs, and so a model, of its own
        assert loaded < most, (task, loaded)
        if task[0] == "humanoid":
            for env in others:
                play(env)
            played = (memory() - before) / len(others)
            assert played < 2.0, (task, played)
    """
    assert run(program(_SMALL_SKY, _MEMORY, _PLAY, body), path=_ROOT) == ""


_HOLD = """
    import sys
    cycles, steps = map(int, sys.argv[1:])

    def load_and_drop(count):
        for cycle in range(count):
            play(suite.load(*suite.ALL_TASKS[cycle % len(suite.ALL_TASKS)]))

    keep = [suite.load(*task) for task in suite.ALL_TASKS]
    load_and_drop(100)
    before = memory()
    load_and_drop(cycles)
    dropped = memory() - before
    assert dropped < 8, dropped  # megabytes

    for env in keep:
        play(env, steps // 50)
    before = memory()
    for env in keep:
        play(env, steps // 10)
    stepped = memory() - before
    assert stepped < 8, stepped  # megabytes
    """


@_HAS_STATM
def test_memory_stays_flat() -> None:
    assert run(program(_SMALL_SKY, _MEMORY, _PLAY, _HOLD), "100", "1500", path=_ROOT) == ""


@_HAS_STATM
@pytest.mark.slow
def test_memory_stays_flat_over_a_million_steps_and_5000_loads() -> None:
    assert run(program(_MEMORY, _PLAY, _HOLD), "5000", "1000000") == ""


def test_this_interpreter_runs_the_programs() -> None:
    assert run("import sys; print(sys.executable)").strip() == sys.executable
