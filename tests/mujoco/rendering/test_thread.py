"""Tests of limberjack.mujoco.rendering.thread: threads, forks, interrupts and the end."""

import os
import sys
import threading
import weakref
from collections.abc import Callable
from concurrent import futures
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Camera, Physics, camera
from limberjack.mujoco.rendering import (
    Pending,
    backends,
    call,
    canvases,
    num_threads,
    prepare,
    thread,
)

_MODEL = """
<mujoco>
  <visual><quality shadowsize="512"/></visual>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="5 5 5" rgba=".3 .6 .3 1"/>
    <body pos="0 0 1"><joint axis="0 1 0"/><geom type="box" size=".4 .1 .1" pos=".3 0 0"/></body>
  </worldbody>
</mujoco>
"""
# For scripts: a physics, a function that draws it, and a wait for a child with a time limit.
_PRELUDE = f"""
import os, signal, sys, threading, time
import numpy as np
from limberjack.mujoco import Camera, Physics
from limberjack.mujoco.rendering import RenderingError, num_threads, thread
physics = Physics.from_xml_string({_MODEL!r})
def draw():
    return physics.render(64, 64)
def draw_rows():
    return rows.render_rows(None, height=64, width=64)
rows = physics.replicate(6, 1)
rows.simulation.state[:, 1] = 0.2 * np.arange(6)
rows.start(np.arange(6))
thread.usable_cores = lambda: 2
def status(pid):
    end = time.monotonic() + 60
    while time.monotonic() < end:
        ended, how = os.waitpid(pid, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(how)
        time.sleep(0.005)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return "hung"
"""

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")


def _turned(angle: float) -> Physics:
    physics = Physics.from_xml_string(_MODEL)
    with physics.reset_context():
        physics.data.qpos[:] = angle
    return physics


# Threads.


def test_sixteen_threads_render_the_same_pictures_as_one() -> None:
    several = [_turned(0.2 * k) for k in range(16)]
    expected = [p.render(64, 64) for p in several]
    together = threading.Barrier(len(several))

    def draw(physics: Physics) -> list[np.ndarray]:
        together.wait()
        camera = Camera(physics, 64, 64)
        return [physics.render(64, 64) for _ in range(5)] + [camera.render()]

    with futures.ThreadPoolExecutor(len(several)) as pool:
        for frames, frame in zip(pool.map(draw, several), expected, strict=True):
            for drawn in frames:
                np.testing.assert_array_equal(drawn, frame)


def test_threads_can_share_a_camera_and_a_physics() -> None:
    physics = _turned(0.5)
    camera = Camera(physics, 64, 64)
    camera.render()
    frame, expected = camera.render(), physics.render(64, 64)
    with futures.ThreadPoolExecutor(8) as pool:
        for drawn in pool.map(lambda _: camera.render(), range(40)):
            np.testing.assert_array_equal(drawn, frame)
    np.testing.assert_array_equal(physics.render(64, 64), expected)


def test_the_callers_own_opengl_context_stays_current() -> None:
    physics = _turned(0.1)
    model, data = physics.model.ptr, physics.data.ptr
    with mujoco.Renderer(model, 32, 32) as renderer:
        renderer.update_scene(data)
        before = renderer.render()
        physics.render(64, 64)
        Camera(physics, 48, 48).render(depth=True)
        # Straight into MuJoCo: `renderer.render()` would make its context current again.
        pixels = np.empty((32, 32, 3), np.uint8)
        rect = mujoco.MjrRect(0, 0, 32, 32)
        mujoco.mjr_render(rect, renderer.scene, renderer._mjr_context)
        mujoco.mjr_readPixels(pixels, None, rect, renderer._mjr_context)
        np.testing.assert_array_equal(pixels[::-1], before)


def test_an_error_on_the_rendering_thread_is_raised_in_the_caller() -> None:
    def fail(*_: Any) -> None:
        raise LookupError("from the other thread")

    with pytest.raises(LookupError, match="from the other thread"):
        call(_turned(0).model._official, fail)


def test_calls_on_the_rendering_thread_can_be_nested() -> None:
    first, second = _turned(0.1), _turned(0.9)
    expected = second.render(64, 64)
    inner = call(first.model._official, lambda _: second.render(64, 64))
    np.testing.assert_array_equal(inner, expected)


def test_nothing_of_a_call_is_kept() -> None:
    model, array = _turned(0).model._official, np.ones(3)
    gone = weakref.ref(array)
    assert call(model, lambda _, a: a.sum(), array) == 3
    del array
    call(model, lambda _: None)
    assert gone() is None


# Several rendering threads.


def _angles() -> list[float]:
    return [0.2 * k for k in range(6)]


def _prepared(physics: Physics, thread: int) -> tuple[camera.Drawing, Pending[np.ndarray]]:
    drawing = physics.begin_render({"height": 64, "width": 64}, thread)
    return drawing, next(drawing)


def test_every_rendering_thread_draws_the_same() -> None:
    several = [_turned(angle) for angle in _angles()]
    expected = [physics.render(64, 64) for physics in several]
    prepared = [_prepared(physics, k % num_threads()) for k, physics in enumerate(several)]
    for _, pending in prepared:
        pending.start()
    drawn = {thread.name for thread in threading.enumerate() if "rendering" in thread.name}
    assert drawn == {"limberjack-rendering"}
    for (drawing, _), frame in zip(prepared, expected, strict=True):
        np.testing.assert_array_equal(camera.completed(drawing), frame)


def test_rendering_threads_do_not_wait_for_one_another() -> None:
    model, both = _turned(0).model._official, threading.Barrier(2)
    call(model, lambda _: None)  # opens OpenGL
    several = [prepare(model, lambda _: both.wait(30), thread=number) for number in (0, 1)]
    for pending in several:
        pending.start()
    assert sorted(pending.result() for pending in several) == [0, 1]


def test_a_call_that_was_cancelled_is_not_made() -> None:
    model, calls = _turned(0).model._official, []
    pending = prepare(model, lambda _: calls.append(1))
    pending.settle()
    pending.start()
    assert call(model, lambda _: list(calls)) == []


def test_the_result_of_a_call_starts_it_once(monkeypatch: pytest.MonkeyPatch) -> None:
    model, calls, queued = _turned(0).model._official, [], []
    pending = prepare(model, lambda _: calls.append(1))
    queue = pending._thread.do

    def counted(job: Callable[[], None]) -> None:
        queued.append(job)
        queue(job)

    monkeypatch.setattr(pending._thread, "do", counted)
    pending.start()
    pending.start()
    assert pending.result() is None
    assert len(queued) == len(calls) == 1


def test_an_interrupted_wait_cancels_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    physics, calls = _turned(0), []
    pending = prepare(physics.model._official, lambda _: calls.append(1))

    def interrupted(*_: Any) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(pending, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pending.result()
    monkeypatch.undo()
    pending.start()
    assert call(physics.model._official, lambda _: list(calls)) == []


def test_a_drawing_that_is_closed_leaves_no_call_behind() -> None:
    physics, frame = _turned(0.4), _turned(0.4).render(64, 64)
    gate = threading.Event()
    blocked = prepare(physics.model._official, lambda _: gate.wait(30))
    blocked.start()
    drawing, pending = _prepared(physics, 0)
    pending.start()
    drawing.close()
    gate.set()
    assert blocked.result()
    call(physics.model._official, lambda _: None)  # after what was queued
    assert pending._job._claim.locked()
    assert not pending._job._is_done
    np.testing.assert_array_equal(physics.render(64, 64), frame)


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> thread._Process:
    """A process that has not drawn, with two cores."""
    process = thread._Process()
    monkeypatch.setattr(thread, "_process", process)
    monkeypatch.setattr(thread, "usable_cores", lambda: 2)
    monkeypatch.delenv("LP_NUM_THREADS", raising=False)
    return process


def test_two_threads_draw_after_the_first_picture_if_there_are_two_backends(
    process: thread._Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = backends.open_backend(), object()
    sought: list[object] = []

    def opened_again(backend: object) -> object:
        sought.append(backend)
        return second

    monkeypatch.setattr(canvases, "opened_again", opened_again)
    assert num_threads() == 1
    process._started_thread(0).canvases.backend = first
    assert (num_threads(), num_threads()) == (2, 2)
    assert sought == [first]
    assert process._started_thread(1).canvases.backend is second


def test_one_thread_draws_if_there_is_no_second_backend(
    process: thread._Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(canvases, "opened_again", lambda _: None)
    process._started_thread(0).canvases.backend = backends.open_backend()
    assert num_threads() == 1


@pytest.mark.parametrize(
    ("limit", "cores", "expected"), [("", 2, 2), ("0", 64, 1), ("1", 2, 1), ("2", 2, 2), ("", 1, 1)]
)
def test_rendering_threads_are_limited_by_cores_and_by_mesas_own_limit(
    limit: str,
    cores: int,
    expected: int,
    process: thread._Process,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process, "num_threads", lambda: 2)
    monkeypatch.setattr(thread, "usable_cores", lambda: cores)
    monkeypatch.setenv("LP_NUM_THREADS", limit)
    assert num_threads() == expected


# Interrupts.


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_leaves_everything_usable(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
camera = Camera(physics, 64, 64)
camera.render()
frame, seen, interrupts = draw(), camera.render(), 0
for k in range(40):
    timer = threading.Timer(0.001 * k % 0.023, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        while True:
            draw(), camera.render()
    except KeyboardInterrupt:
        interrupts += 1
    timer.join()
    assert np.array_equal(draw(), frame) and np.array_equal(camera.render(), seen)
print(interrupts)
"""
    assert run_script(script) == "40\n"


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_leaves_rows_usable(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
frames, interrupts = draw_rows(), 0
assert len({{frame.tobytes() for frame in frames}}) == 6
for k in range(20):
    timer = threading.Timer(0.002 * k % 0.023, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        while True:
            draw_rows()
    except KeyboardInterrupt:
        interrupts += 1
    timer.join()
    assert np.array_equal(draw_rows(), frames)
print(interrupts)
"""
    assert run_script(script) == "20\n"


# Forks.


@needs_fork
def test_a_forked_child_draws_the_same_and_so_does_its_parent(
    run_script: Callable[..., str],
) -> None:
    script = f"""{_PRELUDE}
frame = draw()
for _ in range(3):
    pid = os.fork()
    if pid == 0:
        sys.exit(0 if np.array_equal(draw(), frame) else 3)
    # Flushed: a child would print again what it inherits unprinted.
    print(status(pid), np.array_equal(draw(), frame), flush=True)
"""
    assert run_script(script) == "0 True\n" * 3


@needs_fork
def test_a_child_can_be_forked_while_other_threads_draw(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
others = [Physics.from_xml_string({_MODEL!r}) for _ in range(3)]
frame, is_over, ends = draw(), False, []
def keep_drawing(other):
    while not is_over:
        other.render(100, 100)
threads = [threading.Thread(target=keep_drawing, args=(other,)) for other in others]
for thread in threads:
    thread.start()
for _ in range(3):
    pid = os.fork()
    if pid == 0:
        sys.exit(0 if np.array_equal(draw(), frame) else 3)
    ends.append(status(pid))
is_over = True
for thread in threads:
    thread.join()
print(ends)
"""
    assert run_script(script) == "[0, 0, 0]\n"


@needs_fork
def test_a_child_draws_if_its_parent_did_so_by_other_means(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
import mujoco
renderer = mujoco.Renderer(physics.model.ptr, 32, 32)
renderer.update_scene(physics.data.ptr)
renderer.render()
pid = os.fork()
if pid == 0:
    # As multiprocessing ends its workers: MuJoCo's renderer does not survive the fork.
    os._exit(0 if draw().any() else 3)
print(status(pid))
renderer.close()
"""
    assert run_script(script) == "0\n"


@needs_fork
def test_a_child_of_several_rendering_threads_draws_rows_on_as_many(
    run_script: Callable[..., str],
) -> None:
    script = f"""{_PRELUDE}
frames, is_over = draw_rows(), False
def keep_drawing():
    while not is_over:
        draw_rows()
other = threading.Thread(target=keep_drawing)
other.start()
for _ in range(2):
    pid = os.fork()
    if pid == 0:
        drawn = draw_rows()
        threads = [each.name for each in threading.enumerate()]
        is_right = np.array_equal(drawn, frames)
        is_right = is_right and threads.count("limberjack-rendering") == num_threads()
        sys.exit(0 if is_right else 3)
    print(status(pid), flush=True)
is_over = True
other.join()
print(np.array_equal(draw_rows(), frames))
"""
    assert run_script(script) == "0\n" * 2 + "True\n"


@needs_fork
def test_a_child_that_draws_nothing_ends_as_it_should(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
draw()
for kind in (sys.exit, os._exit):
    pid = os.fork()
    if pid == 0:
        threads = [threading.Thread(target=time.sleep, args=(0.01,)) for _ in range(8)]
        for thread in threads:
            thread.start()
        kind(7)
    print(status(pid))
"""
    assert run_script(script) == "7\n7\n"


@needs_fork
def test_a_grandchild_gets_a_picture_or_a_clear_error(run_script: Callable[..., str]) -> None:
    script = f"""{_PRELUDE}
draw()
pid = os.fork()
if pid == 0:
    draw()
    pid = os.fork()
    if pid == 0:
        try:
            draw()
        except RenderingError as error:
            print(error)
        sys.exit(5)
    print(status(pid))
    sys.exit(6)
print(status(pid))
"""
    *told, child, parent = run_script(script).splitlines()
    assert (child, parent) == ("5", "6")
    assert not told or "'spawn' or 'forkserver'" in told[0]


@pytest.mark.parametrize("method", ["spawn", "fork"])
@needs_fork
def test_worker_processes_draw(run_script: Callable[..., str], method: str) -> None:
    script = f"""
import multiprocessing, os, sys, tempfile
directory = tempfile.mkdtemp()
with open(os.path.join(directory, "worker.py"), "w") as file:
    file.write('''{_PRELUDE.replace(_MODEL.__repr__(), "MODEL")}'''.replace(
        "MODEL", {_MODEL!r}.__repr__()) + "\\ndef work(_):\\n    return draw()\\n")
sys.path.insert(0, directory)
import worker
frame = worker.draw()
with multiprocessing.get_context({method!r}).Pool(1) as pool:
    print(all((drawn == frame).all() for drawn in pool.map(worker.work, range(3))))
"""
    assert run_script(script) == "True\n"


# The end. `run_script` sees to the status 0 and the silence.


@pytest.mark.parametrize(
    "open_things",
    [
        "camera = Camera(physics); camera.render(); context = physics.contexts.mujoco.ptr;"
        " many = [Physics.from_xml_string(xml) for _ in range(9)]; [p.render() for p in many];"
        " physics.cycle = physics; draw()",
        "import mujoco; r = mujoco.Renderer(physics.model.ptr); r.update_scene(physics.data.ptr);"
        " r.render(); draw()",
        "draw(); threading.Thread(target=lambda: [draw() for _ in range(20)]).start()",
        "draw_rows(); threading.Thread(target=lambda: [draw_rows() for _ in range(9)]).start()",
    ],
)
def test_the_process_exits_silently(run_script: Callable[..., str], open_things: str) -> None:
    run_script(f"{_PRELUDE}\nxml = {_MODEL!r}\ndraw()\n{open_things}\n")


@pytest.mark.oracle
@pytest.mark.parametrize("order", ["draw(); theirs.render()", "theirs.render(); draw()"])
def test_the_process_exits_silently_beside_dm_control(
    run_script: Callable[..., str], theirs: Callable[..., Any], order: str
) -> None:
    sizes = "dm_control.mujoco.wrapper.mjbindings"
    run_script(f"""{_PRELUDE}
import mujoco
from {sizes} import sizes
for struct, fields in (("mjmodel", mujoco.MjModel), ("mjdata", mujoco.MjData)):
    table = sizes.array_sizes[struct]
    for name in [name for name in table if not hasattr(fields, name)]:
        del table[name]
import dm_control.mujoco
theirs = dm_control.mujoco.Physics.from_xml_string({_MODEL!r})
{order}
""")


@pytest.mark.parametrize("pause", [0.0, 0.01])
def test_the_process_exits_silently_while_a_daemon_draws(
    run_script: Callable[..., str], pause: float
) -> None:
    run_script(f"""{_PRELUDE}
def keep_drawing():
    while True:
        draw()
draw()
threading.Thread(target=keep_drawing, daemon=True).start()
time.sleep(0.05 + {pause})
""")


def test_drawing_at_the_very_end_is_a_clear_error(run_script: Callable[..., str]) -> None:
    printed = run_script(f"""{_PRELUDE}
import atexit
def last():
    try:
        draw()
    except RenderingError as error:
        print(error)
atexit.register(last)
draw()
""")
    assert "exiting" in printed
