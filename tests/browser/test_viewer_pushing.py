"""Pushing and twisting a body with the mouse, in a real browser.

Studio takes two presses within 0.3 seconds for a double click, by the pictures that its page
draws: seven per second at least. Without a graphics card it draws the suite's models about once
per second, however small the window; so what is viewed here is light to draw, in few pixels.
"""

import itertools
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from .chromium import Page
from .viewing import LIMIT, viewed_by, wait

pytestmark = pytest.mark.browser

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)
Image = pytest.importorskip("PIL.Image", reason="needs Pillow, which comes with the extra 'video'")

_WIDTH, _HEIGHT = 640, 320  # CSS pixels
_SCALE = 0.25  # pixels that are drawn per CSS pixel
_PANEL_WIDTH = 360  # CSS pixels of the left that the panel may cover
_LOOKS = 5  # pictures after a double click that may come before one that shows its effect
_DRAG = 60  # CSS pixels
_HOLDS = (1, 2, 3, 4)  # seconds at a place, one after the other, while dragging has no effect
_POLL = 0.05  # seconds
_CTRL = 2  # the DevTools protocol's number of the modifier
_BUTTONS = {"left": 1, "right": 2}  # its numbers of buttons that are held
_BOX, _BALL = 0, 1  # bodies in what the program writes

# A red box, seen beside the panel, and a blue ball that nobody pushes. Nothing falls. No shadows,
# reflections, sky or smoothing: they take most of the time of a picture without a graphics card.
_MODEL = """
<mujoco>
  <visual><quality shadowsize="0" offsamples="0"/></visual>
  <custom><numeric name="filament.ao.enabled" data="0"/></custom>
  <statistic center="0 0 0" extent="1"/>
  <option timestep="0.01" gravity="0 0 0"/>
  <default><joint damping="1"/><geom mass="1"/></default>
  <worldbody>
    <light pos="0 -2 3" castshadow="false"/>
    <body pos="0.6 0 0">
      <joint type="free"/>
      <geom type="box" size="0.2 0.2 0.2" rgba="1 0 0 1"/>
    </body>
    <body pos="1 0 -0.4">
      <joint type="free"/>
      <geom type="sphere" size="0.1" rgba="0 0 1 1"/>
    </body>
  </worldbody>
</mujoco>
"""

# Views it, and writes a line per step: what was applied to the bodies, and where they are.
_PROGRAM = """
import json
import numpy as np
from limberjack import viewer
from limberjack.mujoco import Physics
from limberjack.rl import control
from limberjack.suite import base

class Nothing(base.Task):
    def get_observation(self, physics):
        return {"position": physics.position()}

    def get_reward(self, physics):
        return 0.0

def policy(time_step):
    data = physics.data
    told = {"applied": data.xfrc_applied, "position": data.xpos, "turn": data.xquat}
    print(json.dumps({name: of[1:].tolist() for name, of in told.items()}), file=file)
    return np.zeros(0)

physics = Physics.from_xml_path("bodies.xml")
environment = control.Environment(physics, Nothing(0), time_limit=1000, control_timestep=0.02)
file = open("spied", "w", buffering=1)
viewer.launch(environment, policy, announce=lambda address: print(address, flush=True))
"""


class _Viewed:
    """A page of the viewer, and what happens to the bodies."""

    def __init__(self, page: Page, directory: Path) -> None:
        self.page = page
        self._directory = directory

    def steps(self) -> int:
        return len(self._lines())

    def since(self, step: int) -> SimpleNamespace:
        """Applied forces, (steps, 2, 6), positions and turns, from a given step on."""
        steps = [json.loads(line) for line in self._lines()[step:]]
        return SimpleNamespace(
            **{name: np.array([told[name] for told in steps]) for name in steps[0]}
        )

    def _lines(self) -> list[str]:
        lines = (self._directory / "spied").read_text().splitlines(keepends=True)
        return [line for line in lines if line.endswith("\n")]

    def picture(self) -> np.ndarray:
        """The picture beside the panel, (height, width, 3), also written to a file."""
        path = self._directory / "page.png"
        self.page.screenshot(path, whole=False)
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"), int)[:, int(_PANEL_WIDTH * _SCALE) :]

    def find_box(self) -> tuple[int, int]:
        """Waits until the box is seen; a point in its middle, CSS pixels."""
        wait(lambda: _red(self.picture()).sum() > 50)
        rows, columns = np.nonzero(_red(self.picture()))
        middle = np.array([np.median(columns), np.median(rows)]) + 0.5
        x, y = (middle / _SCALE).astype(int)
        return int(x) + _PANEL_WIDTH, int(y)

    def choose(self, place: tuple[int, int]) -> None:
        """Double clicks until what is there is chosen: Studio draws a line around it."""
        end = time.monotonic() + LIMIT
        # Held for a picture, a press is surely seen, but two may be too far apart where pictures
        # take long.
        for held in itertools.cycle((1, 0)):
            self._move(*place)
            for count in (1, 2):
                self._mouse("mousePressed", *place, button="left", buttons=1, clickCount=count)
                self.page.wait_for_frames(held)
                self._mouse("mouseReleased", *place, button="left", clickCount=count)
                self.page.wait_for_frames(held)
            for _ in range(_LOOKS):
                if _yellow(self.picture()).sum() > 10:
                    return
            assert time.monotonic() < end, f"no body is chosen after {LIMIT:g} seconds"

    def drag_up(self, place: tuple[int, int], button: str, until: Callable[[], bool]) -> None:
        """Drags with Ctrl until that has had its effect, as often as it takes.

        Studio looks at the mouse and the keys once for each of its own frames, which are rarer than
        the page's on a busy machine. A press and a movement between two looks are one movement; it
        is none if the mouse was there at the look before. So the mouse moves again, after longer
        waits, and lets all go and presses again where that did not help.
        """
        end = time.monotonic() + LIMIT
        while not self._drag_once(place, button, until):
            assert time.monotonic() < end, f"dragging had no effect in {LIMIT:g} seconds"

    def _drag_once(self, place: tuple[int, int], button: str, until: Callable[[], bool]) -> bool:
        """Drags with Ctrl and holds the button for some seconds; whether that had its effect."""
        x, y = place
        about = {"code": "ControlLeft", "key": "Control", "windowsVirtualKeyCode": 17}
        self.page.call("Input.dispatchKeyEvent", type="rawKeyDown", modifiers=_CTRL, **about)
        held = {"button": button, "buttons": _BUTTONS[button], "modifiers": _CTRL}
        self._move(x, y, modifiers=_CTRL)
        self._mouse("mousePressed", x, y, clickCount=1, **held)
        here, other = y - 2 * _DRAG, y - _DRAG
        had_effect = False
        for seconds in _HOLDS:
            here, other = other, here
            self._mouse("mouseMoved", x, here, **held)
            if had_effect := _is_soon(until, seconds):
                break
        for other_button in _BUTTONS.keys() - {button}:
            self._mouse("mouseReleased", x, here, button=other_button, modifiers=_CTRL)
        self._mouse("mouseReleased", x, here, button=button, modifiers=_CTRL, clickCount=1)
        self.page.call("Input.dispatchKeyEvent", type="keyUp", **about)
        return had_effect

    def _move(self, x: int, y: int, **about: object) -> None:
        """Moves there, and waits until Studio knows: a press in the same picture would drag."""
        self._mouse("mouseMoved", x, y, **about)
        self.page.wait_for_frames(2)

    def _mouse(self, kind: str, x: int, y: int, **about: object) -> None:
        self.page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **about)


def _is_soon(until: Callable[[], bool], seconds: float) -> bool:
    """Whether something becomes so within some seconds."""
    end = time.monotonic() + seconds
    while not until():
        if time.monotonic() > end:
            return False
        time.sleep(_POLL)
    return True


def _red(picture: np.ndarray) -> np.ndarray:
    red, green, blue = np.moveaxis(picture, -1, 0)
    return (red > 100) & (green < 40) & (blue < 40)


def _yellow(picture: np.ndarray) -> np.ndarray:
    red, green, blue = np.moveaxis(picture, -1, 0)
    return (red > 60) & (green > 60) & (abs(red - green) < 25) & (blue < 60)


@pytest.fixture(scope="module")
def viewed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[_Viewed]:
    directory = tmp_path_factory.mktemp("push")
    (directory / "bodies.xml").write_text(_MODEL)
    with viewed_by(["-c", _PROGRAM], directory, _WIDTH, _HEIGHT, _SCALE) as (page, _):
        yield _Viewed(page, directory)


@pytest.fixture(scope="module")
def box(viewed: _Viewed) -> SimpleNamespace:
    """The box, chosen: where it was on the page, and what was seen of the bodies so far."""
    place = viewed.find_box()
    viewed.choose(place)
    return SimpleNamespace(place=place, seen=viewed.since(0))


def test_choosing_a_body_does_nothing_to_it(box: SimpleNamespace) -> None:
    assert not box.seen.applied.any()
    assert not np.ptp(box.seen.position, axis=0).any()


def test_the_right_button_pushes_the_chosen_body(viewed: _Viewed, box: SimpleNamespace) -> None:
    begun = viewed.steps() - 1
    height = viewed.since(begun).position[0, _BOX, 2]
    viewed.drag_up(
        box.place, "right", until=lambda: viewed.since(begun).position[-1, _BOX, 2] > height + 0.1
    )
    wait(lambda: not viewed.since(begun).applied[-1].any())  # it was let go
    seen = viewed.since(begun)
    assert seen.applied[:, _BOX, 2].max() > 0.1  # N, upwards
    assert not seen.applied[:, _BALL].any()


def test_the_left_button_twists_the_chosen_body(viewed: _Viewed, box: SimpleNamespace) -> None:
    begun = viewed.steps() - 1
    turn = viewed.since(begun).turn[0, _BOX]
    viewed.drag_up(
        box.place, "left", until=lambda: abs(viewed.since(begun).turn[-1, _BOX] @ turn) < 0.99
    )
    wait(lambda: not viewed.since(begun).applied[-1].any())
    seen = viewed.since(begun)
    assert abs(seen.applied[:, _BOX, 3:]).max() > 0.1  # N m
    assert not seen.applied[:, _BOX, :3].any()
    assert not seen.applied[:, _BALL].any()


def test_the_page_does_not_complain(viewed: _Viewed, box: SimpleNamespace) -> None:
    assert viewed.page.errors == []
