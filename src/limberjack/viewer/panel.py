"""`Panel`: the window that shows a session's status and takes a person's wishes, in Dear ImGui.

    panel = Panel("humanoid walk", session, send, imgui, implot)
    panel.show(status)
    panel.draw()  # again for each frame

A wish is a function of the session, which `send` lets the thread that steps it call. The panel
itself reads nothing of the session but what never changes. It imports no ImGui: it is given that of
MuJoCo Studio, which draws in the browser of the person in control, and that of its charts.

ImGui tells widgets apart by their labels, of which it shows the part before "##": names of a task
or a planner get an ending, so that a term called speed does not move the slider of the speed.
"""

import collections
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import ModuleType

import numpy as np

from limberjack.utils.seeds import SEEDS
from limberjack.viewer.session import TERMINAL, Plan, Session, Status
from limberjack.viewer.shown import QUALITIES

__all__ = ["Panel", "Weigh", "Wish", "Worded"]

Wish = Callable[[Session], object]
Weigh = Callable[[str, float], None]  # gives a term of the planner's cost another weight
Worded = Callable[[Status], str]  # to a command line

_PLACE = (16.0, 48.0, 340.0, 500.0)  # left, top, width, height; pixels
_CHART_HEIGHT = 150.0  # pixels
_CHARTED = 400  # steps
_SLOWEST, _FASTEST = 0.1, 4.0  # simulated seconds per second, of the slider
_HEAVIEST = 4.0  # of the sliders of weights, times the weight that the cost has
_KEYS = {
    "Space": "pause, continue",
    "Right arrow": "one control step, while paused",
    "Left arrow": "look back in time, while paused",
    "Backspace": "next episode",
    "- and =": "slower, faster",
    "Double click": "select a body",
    "Ctrl, right button": "push it",
    "Ctrl, left button": "twist it",
    "[ and ]": "the model's cameras",
    "?": "this list",
}


class Panel:
    """A window of Dear ImGui; see the module's docstring."""

    def __init__(
        self,
        title: str,
        session: Session,
        send: Callable[[Wish], None],
        imgui: ModuleType,
        implot: ModuleType,
        weigh: Weigh | None = None,
        command: Worded | None = None,
    ) -> None:
        """Takes what never changes from a session that has begun.

        Args:
          title: of the window.
          session: the one that is shown.
          send: called with wishes.
          imgui: Dear ImGui.
          implot: its charts.
          weigh: changes the planner's weights, where plans are shown.
          command: returns the command line of a status; None for none.
        """
        self._title = title or "limberjack"  # ImGui ends the process at an empty one
        self._send, self._imgui, self._implot = send, imgui, implot
        self._weigh, self._command = weigh, command
        self._policies, self._kinds = session.policies, session.kinds
        self._actuators, self._is_seeded = session.actuators(), session.is_seeded
        self._status: Status | None = None
        self._seed = 0  # in the field, until it is begun
        self._shows_keys = False
        self._weights: dict[str, float] = {}  # of the cost, before a person changed them
        self._charted: dict[str, collections.deque[float]] = {}
        self._episode = 0  # that is charted

    def show(self, status: Status) -> None:
        """Shows a status from the next frame on."""
        if status.episode != self._episode:
            self._charted.clear()
            self._episode = status.episode
            self._seed = self._seed if status.seed is None else status.seed
        is_new = self._status is None or status.step != self._status.step
        if is_new and status.reward is not None:
            for name, value in {"reward": status.reward, **status.terms}.items():
                values = self._charted.setdefault(name, collections.deque(maxlen=_CHARTED))
                values.append(value)
        self._status = status

    def draw(self) -> None:
        """Draws the window."""
        imgui = self._imgui
        left, top, width, height = _PLACE
        first = int(imgui.Cond.FirstUseEver)
        imgui.SetNextWindowPos(imgui.Vec2(left, top), first)
        imgui.SetNextWindowSize(imgui.Vec2(width, height), first)
        is_open, _ = imgui.Begin(self._title)
        if is_open and self._status is not None:
            self._draw_parts(self._status)
        imgui.End()
        if imgui.IsKeyPressed(imgui.Key.Slash, False) and imgui.GetIO().KeyShift:
            self._shows_keys = not self._shows_keys
        if self._shows_keys:
            self._draw_keys()

    def _draw_parts(self, status: Status) -> None:
        self._draw_buttons(status)
        self._draw_choices(status)
        self._draw_episode(status)
        self._draw_reward(status)
        if status.action and self._actuators:
            self._draw_action(status.action)
        if status.plan is not None:
            self._draw_plan(status.plan)
        if self._command is not None:
            self._draw_command(self._command(status))

    def _draw_buttons(self, status: Status) -> None:
        imgui = self._imgui
        if imgui.Button("Run" if status.paused else "Pause"):
            paused = not status.paused
            self._send(lambda session: session.pause(paused))
        imgui.SetItemTooltip("Space")
        imgui.SameLine()
        if imgui.Button("Step"):
            self._send(_step)
        imgui.SetItemTooltip("One control step; right arrow while paused")
        imgui.SameLine()
        if imgui.Button("Reset"):
            self._send(lambda session: session.reset())
        imgui.SetItemTooltip("The next episode, with a new seed; backspace")
        imgui.SameLine()
        if imgui.Button("?"):
            self._shows_keys = not self._shows_keys
        imgui.SetItemTooltip("Keys")

    def _draw_choices(self, status: Status) -> None:
        """Policy, speed, seed, start and quality."""
        imgui = self._imgui
        policy = self._choose("policy", self._policies, status.policy)
        if policy is not None:
            self._send(lambda session: session.choose(policy))
        changed, speed = imgui.SliderFloat("speed", status.speed, _SLOWEST, _FASTEST, "%.2f x")
        if changed and speed > 0:
            self._send(lambda session: session.set_speed(speed))
        if self._is_seeded:
            # Whole numbers of its own have 31 bits; seeds have 32.
            _, typed = imgui.InputDouble("##seed", float(self._seed), 1.0, 100.0, "%.0f")
            self._seed = int(min(max(0.0, typed), SEEDS - 1))
            imgui.SameLine()
            if imgui.Button("Begin seed"):
                seed = self._seed
                self._send(lambda session: session.begin(seed))
        for number, kind in enumerate(self._kinds):
            if number:
                imgui.SameLine()
            if imgui.SmallButton(f"{kind}##start"):
                self._send(lambda session, kind=kind: session.begin_kind(kind))
            imgui.SetItemTooltip("The next start of this kind")
        quality = self._choose("quality", QUALITIES, status.quality)
        if quality is not None:
            self._send(lambda session: session.shown.set_quality(quality))
        imgui.SetItemTooltip("fast: no shadows, reflections, darkened corners and smooth edges")

    def _choose(self, label: str, names: Sequence[str], name: str) -> str | None:
        """The name that the person has chosen from a list; None if it is the present one."""
        now = names.index(name)
        changed, chosen = self._imgui.Combo(label, now, list(names))
        return names[int(chosen)] if changed and chosen != now else None

    def _draw_episode(self, status: Status) -> None:
        imgui = self._imgui
        seed = "" if status.seed is None else f", seed {status.seed}"
        start = "" if status.start is None else f", {status.start}"
        limit = "" if status.step_limit is None else f" of {status.step_limit}"
        paused = ", paused" if status.paused else ""
        imgui.TextUnformatted(f"episode {status.episode}{seed}{start}")
        imgui.TextUnformatted(f"step {status.step}{limit}, {status.time:.2f} s{paused}")
        if status.note:
            imgui.TextWrapped(status.note)

    def _draw_reward(self, status: Status) -> None:
        imgui = self._imgui
        reward = "-" if status.reward is None else f"{status.reward:.3f}"
        imgui.SeparatorText("Reward")
        imgui.TextUnformatted(f"return {status.total:.2f}")
        self._draw_bar(status.reward or 0.0, reward, "reward")
        if status.terms:
            imgui.SeparatorText("Terms")
        for name, value in status.terms.items():
            self._draw_bar(value, f"{value:.3f}", name)
        if status.success is not None:
            imgui.TextUnformatted("goal reached" if status.success else "goal not reached")
        self._draw_chart(status)

    def _draw_chart(self, status: Status) -> None:
        """The reward and its terms over the last steps."""
        implot = self._implot
        size = self._imgui.Vec2(-1.0, _CHART_HEIGHT)
        if not self._charted or not implot.BeginPlot("##chart", size):
            return
        implot.SetupAxes("", "", int(implot.AxisFlags.AutoFit), int(implot.AxisFlags.AutoFit))
        for name, values in self._charted.items():
            first = status.step - len(values) + 1
            implot.PlotLine(name, [float(first + i) for i in range(len(values))], list(values))
        implot.EndPlot()

    def _draw_action(self, action: tuple[float, ...]) -> None:
        """A slider for each actuator."""
        if not self._imgui.CollapsingHeader("Controls"):
            return
        values = np.array(action)
        for number, actuator in enumerate(self._actuators):
            label, now = f"{actuator.name}##control", action[number]
            changed, value = self._imgui.SliderFloat(label, now, actuator.low, actuator.high)
            if changed:
                values[number] = np.clip(value, actuator.low, actuator.high)
                self._send(lambda session: session.set_action(values))

    def _draw_plan(self, plan: Plan) -> None:
        """The stage, each term's share of the cost, and its weight."""
        imgui = self._imgui
        imgui.SeparatorText("Plan")
        if plan.stage:
            imgui.TextWrapped(plan.stage)
        total = sum(abs(value) for value in plan.terms.values()) or 1.0
        for name, value in plan.terms.items():
            self._draw_bar(abs(value) / total, f"{value:.3f}", name)
        if self._weigh is not None and imgui.CollapsingHeader("Weights"):
            self._draw_weights(self._weigh, plan.terms.keys(), plan.weights)

    def _draw_weights(
        self, weigh: Weigh, terms: Iterable[str], weights: Mapping[str, float]
    ) -> None:
        for name in terms:
            if name == TERMINAL:  # which has no weight
                continue
            weight = weights.get(name, 1.0)
            before = self._weights.setdefault(name, weight) or 1.0
            label, most = f"{name}##weight", _HEAVIEST * before
            changed, value = self._imgui.SliderFloat(label, weight, 0.0, most)
            if changed:
                self._send(lambda session, name=name, value=value: weigh(name, max(0.0, value)))

    def _draw_command(self, command: str) -> None:
        """The command line of this view, in a field from which it can be copied."""
        imgui = self._imgui
        imgui.SeparatorText("This view")
        imgui.SetNextItemWidth(-1.0)
        imgui.InputText("##command", command, int(imgui.InputTextFlags.ReadOnly))
        if imgui.Button("Copy"):
            imgui.SetClipboardText(command)

    def _draw_keys(self) -> None:
        imgui = self._imgui
        is_open, _ = imgui.Begin("Keys")
        if is_open:
            for key, effect in _KEYS.items():
                imgui.TextUnformatted(f"{key}: {effect}")
        imgui.End()

    def _draw_bar(self, value: float, text: str, name: str) -> None:
        imgui = self._imgui
        imgui.ProgressBar(min(max(value, 0.0), 1.0), imgui.Vec2(_PLACE[2] / 2, 0.0), text)
        imgui.SameLine()
        imgui.TextUnformatted(name)


def _step(session: Session) -> None:
    """One control step, after which the session is paused."""
    session.pause()
    session.step()
