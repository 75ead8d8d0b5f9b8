"""The panel of the viewer in a real browser: policies, recordings, and who may use it.

Nothing but a box is drawn, as in `test_viewer_pushing`, so that frames are short without a graphics
card. The panel is in its first place, at which its widgets are clicked.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from .chromium import SOFTWARE_WEBGL, Chromium, Page
from .viewing import LIMIT, serving, wait

pytestmark = pytest.mark.browser

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)

_WIDTH, _HEIGHT, _SCALE = 640, 600, 0.5  # CSS pixels; pixels drawn per CSS pixel
_POLICIES, _SECOND = (120, 116), (60, 162)  # the list of policies, and its second entry
_STEP = (79, 90)
_FRAMES = 15  # in which a click of a person who only watches has no effect
_SMALLEST_FILM = 200  # bytes; with a picture in it

# Shows a box with one motor, and writes a line for each step: policy and control.
_PROGRAM = """
from limberjack import viewer
from limberjack.mujoco import Physics
from limberjack.rl import control
from limberjack.suite import base
from limberjack.viewer.access import Access, find_address
from limberjack.viewer.session import Session
from limberjack.viewer.shown import Shown

MODEL = '''
<mujoco>
  <visual><quality shadowsize="0" offsamples="0"/></visual>
  <custom><numeric name="filament.ao.enabled" data="0"/></custom>
  <statistic center="0 0 0" extent="1"/>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <light pos="0 -2 3" castshadow="false"/>
    <body>
      <joint name="slide" type="slide" damping="10"/>
      <geom type="box" size="0.2 0.2 0.2" rgba="1 0 0 1"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slide" ctrlrange="-1 1"/></actuator>
</mujoco>
'''

class Nothing(base.Task):
    def get_observation(self, physics):
        return {"position": physics.position()}

    def get_reward(self, physics):
        if session is not None:
            print(session.status().policy, physics.control()[0], file=file)
        return 0.5

class Told(Shown):
    def drawn_by_software(self):
        super().drawn_by_software()
        with open("told", "a") as told:
            print("by software", file=told)

session = None
file = open("spied", "w", buffering=1)
physics = Physics.from_xml_string(MODEL)
environment = control.Environment(physics, Nothing(0), time_limit=1000, control_timestep=0.02)
show = viewer.in_browsers(Access(find_address()), "box", lambda url: print(url, flush=True))
session = Session(environment, seed=3, policies=viewer.offered(environment, ["none", "random"]))
session.shown = Told(environment)
show(session)
"""


class _Viewed:
    """The page of the person in control, and what the environment does."""

    def __init__(self, page: Page, address: str, directory: Path, browser: Chromium) -> None:
        self.page, self.address, self.directory, self.browser = page, address, directory, browser

    def lines(self) -> list[str]:
        return (self.directory / "spied").read_text().splitlines()

    def policy(self) -> str:
        """The policy of the last step."""
        return self.lines()[-1].split()[0]


def _click(page: Page, place: tuple[int, int]) -> None:
    """Clicks so that Studio notices: it takes one event from each frame that it draws."""
    x, y = place
    about = {"x": x, "y": y, "button": "left", "clickCount": 1}
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    page.wait_for_frames(2)
    for kind in ("mousePressed", "mouseReleased"):
        page.call("Input.dispatchMouseEvent", type=kind, **about)
        page.wait_for_frames(2)


@pytest.fixture(scope="module")
def viewed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[_Viewed]:
    directory = tmp_path_factory.mktemp("panel")
    with (
        Chromium(directory, *SOFTWARE_WEBGL) as browser,
        serving(["-c", _PROGRAM], directory) as address,
    ):
        page = browser.open(address, _WIDTH, _HEIGHT, _SCALE)
        made = _Viewed(page, address, directory, browser)
        wait(lambda: bool(made.lines()))
        yield made


def test_a_policy_is_switched_at_the_panel(viewed: _Viewed) -> None:
    assert viewed.lines()[0] == "none 0.0"
    end = time.monotonic() + LIMIT
    while viewed.policy() != "random":  # the panel appears some frames after the page
        assert time.monotonic() < end, "the policy was not switched"
        _click(viewed.page, _POLICIES)
        _click(viewed.page, _SECOND)
    wait(lambda: viewed.lines()[-1] != viewed.lines()[-2])


def test_a_page_without_a_graphics_card_says_so(viewed: _Viewed) -> None:
    wait(lambda: (viewed.directory / "told").exists())
    assert (viewed.directory / "told").read_text() == "by software\n"


def test_who_comes_second_watches_only(viewed: _Viewed) -> None:
    other = viewed.browser.open(viewed.address, _WIDTH, _HEIGHT, _SCALE)
    other.wait_for_frames(_FRAMES)
    for place in (_STEP, _POLICIES, _SECOND):
        _click(other, place)
    other.wait_for_frames(_FRAMES)
    before = len(viewed.lines())
    wait(lambda: len(viewed.lines()) > before)  # not paused
    assert viewed.policy() == "random"
    other.call("Page.close")


def test_a_recording_is_a_download_of_the_browser(viewed: _Viewed) -> None:
    page, films = viewed.page, viewed.directory / "films"
    viewed.browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(films))
    button = "document.getElementById('record')"
    page.evaluate(f"{button}.click()")
    page.wait_for(f"{button}.textContent == 'Stop and save'")  # there is a picture
    page.evaluate(f"{button}.click()")
    page.wait_for(f"{button}.textContent == 'Record'")
    wait(lambda: any(film.stat().st_size > _SMALLEST_FILM for film in films.glob("limberjack.*")))


def test_the_page_asks_nobody_else_and_does_not_complain(viewed: _Viewed) -> None:
    own = viewed.address.partition("?")[0]
    assert all(request.startswith(own) for request in viewed.page.requests)
    assert viewed.page.errors == []
