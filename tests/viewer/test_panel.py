"""The panel with an ImGui that records what is drawn and clicks what a test says."""
# ruff: noqa: N802 (Dear ImGui's names)

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack import suite, viewer
from limberjack.viewer.panel import Panel, Wish
from limberjack.viewer.session import Actuator, Plan, Session, idle


class _ImGui:
    """Dear ImGui and its charts: `texts` is what was drawn, `answers` what the person does."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.labels: list[str] = []  # of the widgets that take input
        self.answers: dict[str, Any] = {}  # by the label of a widget
        self.lines: dict[str, tuple[list[float], list[float]]] = {}
        self.copied = ""
        self.shift = False
        self.Cond = SimpleNamespace(FirstUseEver=4)
        self.Key = SimpleNamespace(Slash="slash")
        self.InputTextFlags = SimpleNamespace(ReadOnly=1)
        self.AxisFlags = SimpleNamespace(AutoFit=1)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments: arguments

    def _drawn(self, text: str) -> None:
        self.texts.append(text)

    TextUnformatted = TextWrapped = SeparatorText = _drawn

    def Begin(self, title: str) -> tuple[bool, bool]:
        assert title  # as Dear ImGui asserts, which ends the process
        self._drawn(title)
        return True, True

    def _drawn_widget(self, label: str, text: str) -> None:
        self.labels.append(label)
        self._drawn(label.partition("##")[0] + text)

    def Button(self, label: str) -> bool:
        self._drawn_widget(label, "")
        return bool(self.answers.pop(label, False))

    SmallButton = CollapsingHeader = Button

    def Combo(self, label: str, now: int, items: list[str]) -> tuple[bool, int]:
        self._drawn_widget(label, f": {' '.join(items)}")
        return label in self.answers, self.answers.pop(label, now)

    def SliderFloat(self, label: str, value: float, *limits: object) -> tuple[bool, float]:
        self._drawn_widget(label, f" {value:g} {limits}")
        return label in self.answers, self.answers.pop(label, value)

    def InputDouble(self, label: str, value: float, *how: object) -> tuple[bool, float]:
        assert how == (1.0, 100.0, "%.0f")
        return label in self.answers, self.answers.pop(label, value)

    def InputText(self, label: str, text: str, flags: int) -> None:
        assert flags == self.InputTextFlags.ReadOnly
        self._drawn(text)

    def ProgressBar(self, share: float, size: object, text: str) -> None:
        self._drawn(f"{share:.2f} {text}")

    def SetClipboardText(self, text: str) -> None:
        self.copied = text

    def GetIO(self) -> SimpleNamespace:
        return SimpleNamespace(KeyShift=self.shift)

    def IsKeyPressed(self, key: str, repeat: bool) -> bool:
        assert not repeat
        return self.answers.pop(key, False)

    def BeginPlot(self, title: str, size: object) -> bool:
        return True

    def PlotLine(self, name: str, xs: list[float], ys: list[float]) -> None:
        self.lines[name] = xs, ys


class _Shown:
    """A session, its panel, and the person at it."""

    def __init__(self, domain: str, task: str, title: str = "view", **arguments: Any) -> None:
        environment = suite.load(domain, task, task_kwargs={"random": 0, "time_limit": 1.0})
        begins = {"none": idle, "random": viewer.begin_with("random")}
        self.session = Session(environment, seed=3, policies=begins, clock=lambda: 0.0)
        self.imgui = _ImGui()
        self.panel = Panel(title, self.session, self._apply, self.imgui, self.imgui, **arguments)  # pyright: ignore[reportArgumentType] (a fake module)
        self.draw()

    def _apply(self, wish: Wish) -> None:
        wish(self.session)

    def draw(self, status: Any = None, /, **answers: Any) -> str:
        """Draws a frame in which the person does something; returns what was drawn."""
        self.imgui.answers = answers
        self.imgui.texts.clear()
        self.imgui.labels.clear()
        self.panel.show(status or self.session.status())
        self.panel.draw()
        assert not self.imgui.answers, "a widget was not drawn"
        return "\n".join(self.imgui.texts)


@pytest.fixture(scope="module")
def arm() -> _Shown:
    """A task with kinds of starts."""
    return _Shown("swimmer", "swimmer6")


def test_buttons_pause_step_and_reset(arm: _Shown) -> None:
    session = arm.session
    arm.draw(Pause=True)
    assert session.paused
    arm.draw(Run=True)
    assert not session.paused
    before = session.status()
    assert before.seed is not None
    arm.draw(Step=True)
    assert (session.paused, session.status().step) == (True, before.step + 1)
    arm.draw(Reset=True)
    assert (session.status().episode, session.status().seed) == (
        before.episode + 1,
        before.seed + 1,
    )


def test_a_policy_is_switched_live_and_only_those_offered_are_listed(arm: _Shown) -> None:
    arm.session.step()
    before = arm.session.status()
    assert "policy: none random" in arm.draw(policy=1)
    after = arm.session.status()
    assert (after.policy, after.step, after.episode) == ("random", before.step, before.episode)
    arm.draw(policy=0)
    assert arm.session.status().policy == "none"


def test_a_speed_and_a_seed_are_chosen(arm: _Shown) -> None:
    arm.draw(speed=0.5)
    assert arm.session.speed == 0.5
    arm.draw(speed=1.0)
    arm.draw(**{"##seed": 41, "Begin seed": True})
    assert arm.session.status().seed == 41
    arm.draw(Reset=True)
    arm.draw(**{"Begin seed": True})  # the field follows the episodes
    assert arm.session.status().seed == 42
    arm.draw(**{"##seed": 2.0**32 - 1, "Begin seed": True})  # the last one there is
    assert arm.session.status().seed == 2**32 - 1
    arm.draw(**{"##seed": -3.0, "Begin seed": True})
    assert arm.session.status().seed == 0


def test_a_quality_is_chosen(arm: _Shown) -> None:
    assert "quality: auto full fast" in arm.draw(quality=2)
    assert arm.session.status().quality == "fast"
    arm.draw(quality=0)
    assert arm.session.status().quality == "auto"


def test_each_kind_of_start_has_a_button(arm: _Shown) -> None:
    for kind in ("far", "close", "far"):
        arm.draw(**{f"{kind}##start": True})
        assert arm.session.status().start == kind


def test_sliders_set_the_controls_where_no_policy_acts(arm: _Shown) -> None:
    name = arm.session.actuators()[2].name
    beyond = 7.0  # the slider's end, as typed
    drawn = arm.draw(Controls=True, **{f"{name}##control": beyond})
    assert f"{name} 0 (-1.0, 1.0)" in drawn
    assert arm.session.status().action == (0.0, 0.0, 1.0, 0.0, 0.0)
    arm.session.step()
    np.testing.assert_array_equal(arm.session.data.ctrl, [0.0, 0.0, 1.0, 0.0, 0.0])
    arm.draw(policy=1)
    assert "Controls" not in arm.draw()
    arm.draw(policy=0)


def test_the_chart_has_the_last_steps_of_the_episode() -> None:
    shown = _Shown("walker", "stand")
    assert shown.imgui.lines == {}
    for _ in range(3):
        shown.session.step()
        shown.draw()
        shown.draw()  # another frame of the same step
    steps, rewards = shown.imgui.lines["reward"]
    assert steps == [1.0, 2.0, 3.0]
    assert rewards[-1] == shown.session.status().reward
    assert shown.imgui.lines.keys() == {"reward", *shown.session.status().terms}
    shown.session.reset()
    shown.draw()
    shown.session.step()
    shown.draw()
    assert shown.imgui.lines["reward"][0] == [1.0]


def test_a_question_mark_or_its_button_shows_the_keys(arm: _Shown) -> None:
    assert "Keys" not in arm.draw(slash=True)  # not a question mark
    arm.imgui.shift = True
    assert "Backspace: next episode" in arm.draw(slash=True)
    assert "Keys" not in arm.draw(slash=True)
    arm.imgui.shift = False
    assert "Keys" in arm.draw(**{"?": True})
    assert "Keys" not in arm.draw(**{"?": True})


def test_the_command_line_of_the_view_can_be_copied() -> None:
    shown = _Shown("swimmer", "swimmer6", command=lambda status: f"view --seed {status.seed}")
    assert "view --seed 3" in shown.draw(Copy=True)
    assert shown.imgui.copied == "view --seed 3"


def test_a_plan_is_drawn_as_shares_of_its_cost_with_its_weights() -> None:
    given: list[tuple[str, float]] = []
    shown = _Shown("swimmer", "swimmer6", weigh=lambda name, value: given.append((name, value)))
    plan = Plan("carry", {"reach": 3.0, "grasp": 1.0, "terminal": 0.0}, {"reach": 5.0})
    status = dataclasses.replace(shown.session.status(), plan=plan)
    drawn = shown.draw(status)
    for text in ("Plan", "carry", "0.75 3.000", "0.25 1.000"):
        assert text in drawn
    drawn = shown.draw(status, Weights=True, **{"reach##weight": 2.5})
    assert "reach 5 (0.0, 20.0)" in drawn
    assert "grasp 1 (0.0, 4.0)" in drawn
    assert "terminal 1 (" not in drawn  # it has no weight
    assert given == [("reach", 2.5)]
    lighter = dataclasses.replace(status, plan=plan._replace(weights={"reach": 0.0}))
    assert "reach 0 (0.0, 20.0)" in shown.draw(lighter, Weights=True)  # the slider's end stays


def test_a_panel_without_a_title_has_the_package_s_name() -> None:
    assert _Shown("swimmer", "swimmer6", title="").draw().startswith("limberjack\n")


def test_a_name_of_the_task_or_of_the_plan_is_not_taken_for_another_widget(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    actuators = tuple(Actuator(name, -1.0, 1.0) for name in ("speed", "reach"))
    monkeypatch.setattr(Session, "actuators", lambda self: actuators)
    monkeypatch.setattr(Session, "kinds", ("Step", "Reset"))
    shown = _Shown("swimmer", "swimmer6", weigh=lambda name, value: None)
    plan = Plan("", {"speed": 1.0, "reach": 1.0})
    status = dataclasses.replace(shown.session.status(), plan=plan, action=(0.0, 0.0))
    drawn = shown.draw(status, Controls=True, Weights=True).splitlines()
    assert {"speed 1 (0.1, 4.0, '%.2f x')", "speed 0 (-1.0, 1.0)", "speed 1 (0.0, 4.0)"} < {*drawn}
    assert len(set(shown.imgui.labels)) == len(shown.imgui.labels)
