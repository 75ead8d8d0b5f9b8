"""A viewer of live environments: MuJoCo Studio in a browser, or a window.

    from limberjack import suite, viewer

    env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
    viewer.launch(env, policy=lambda time_step: my_action(time_step.observation))

It answers to `dm_control.viewer.launch` too. The command is `limberjack view`.
"""

import contextlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dm_env import specs

from limberjack import policies
from limberjack.policies.built_in import PLANNER
from limberjack.rl.builds import takes_a_seed
from limberjack.rl.control import Environment
from limberjack.utils.seeds import checked_seed
from limberjack.viewer.access import Access, find_address
from limberjack.viewer.panel import Weigh, Worded
from limberjack.viewer.session import NO_POLICY, TERMINAL, Act, Begin, Plan, Session, idle
from limberjack.viewer.shown import AUTO, Viewed

if TYPE_CHECKING:
    from limberjack.planner import Planner

# Any: whatever `Session` takes, or a function of a seed or of nothing that makes it.
_Loader = Any
__all__ = [
    "Plans",
    "begin_policy",
    "begin_with",
    "in_browsers",
    "in_window",
    "launch",
    "offered",
]


def launch(
    environment_loader: _Loader,
    policy: Act | str | Sequence[Act | str] | None = None,
    title: str = "limberjack",
    width: int = 1024,
    height: int = 768,
    *,
    native: bool = False,
    host: str = "127.0.0.1",
    port: int | None = None,
    allow_hosts: Sequence[str] = (),
    seed: int | None = None,
    speed: float = 1.0,
    announce: Callable[[str], object] = print,
    explain: bool = False,
    quality: str = AUTO,
) -> None:
    """Shows a live environment until the viewer is closed, or Ctrl-C is pressed.

    Args:
      environment_loader: a `control.Environment`, or a function that makes one, which is then
        closed at the end. One that needs an argument is given the seed, or 0 if there is none.
      policy: a function from a `dm_env.TimeStep` to an action, whose `reset()`, if it has one, is
        called at the start of each episode; or a name as in `limberjack.policies`; None acts with
        the middle of the actions' bounds. Of several, the first one acts. The panel offers all, and
        the built-in ones that fit.
      title: of the panel with the reward.
      width: accepted for programs written for dm_control, and not used: browsers and the window
        have sizes of their own.
      height: likewise.
      native: open a window, instead of serving browsers.
      host: the address to listen on, of this machine; by default no other machine can reach it.
      port: to listen on; None for the first free one from 8080 on.
      allow_hosts: names under which browsers may reach it besides this machine's own, as through a
        proxy.
      seed: of the first episode; the next has seed + 1. None continues the environment's random
        stream from episode to episode.
      speed: simulated seconds per second.
      announce: called with the address to open in a browser, which carries the token that lets
        it in.
      explain: show stage, terms and weights of the plans of the policy 'planner', which is offered.
      quality: 'fast' shows no shadows, reflections, darkened corners and smooth edges; 'full' shows
        them; 'auto' shows them unless a browser draws without a GPU.

    Raises:
      ImportError: MuJoCo Studio cannot be imported.
      PolicyError: there is no policy of a name, or it does not fit.
      ValueError: the port is in use, or another argument has a wrong value; nothing is started.
      TypeError: the environment has no MuJoCo simulation to show, or `allow_hosts` is no list.
      ViewerError: there is no display for a window, or Studio does not start.
    """
    plans = Plans()
    show = (
        in_window()
        if native
        else in_browsers(
            Access(find_address(host, port), allow_hosts), title, announce, plans.weigh
        )
    )
    chosen: list[Act | str] = [PLANNER] if explain else []
    if isinstance(policy, str) or not isinstance(policy, Sequence):
        chosen.insert(0, NO_POLICY if policy is None else policy)
    else:
        chosen = [*policy, *chosen]
    with contextlib.ExitStack() as stack:
        environment = environment_loader
        if not isinstance(environment, Environment) and callable(environment):
            environment = _made(environment, seed)
            stack.callback(getattr(environment, "close", lambda: None))
        begins = offered(environment, chosen, plans if explain else None)
        stack.enter_context(contextlib.suppress(KeyboardInterrupt))
        session = Session(
            environment, begins, seed=seed, speed=speed, plan=plans.last, quality=quality
        )
        show(session)


def in_browsers(
    access: Access,
    title: str,
    announce: Callable[[str], object],
    weigh: Weigh | None = None,
    command: Worded | None = None,
) -> Callable[[Session], None]:
    """A function that shows a session in browsers; see `limberjack.viewer.studio`.

    Args:
      access: where to listen, and what to answer.
      title: of the panel.
      announce: called with the address.
      weigh: gives a term of the planner's cost another weight, where plans are shown.
      command: returns the command line of a status, for the person to copy.

    Raises:
      ImportError: MuJoCo Studio cannot be imported.
    """
    from limberjack.viewer import studio

    return lambda session: studio.run(session, access, title, announce, weigh, command)


def in_window() -> Callable[[Session], None]:
    """A function that shows a session in a window; see `limberjack.viewer.window`."""
    from limberjack.viewer import window

    return window.run


def _made(loader: Callable[..., Viewed], seed: int | None) -> Viewed:
    """The environment that the function makes, given the seed if it needs an argument."""
    try:
        inspect.signature(loader).bind()
    except TypeError:
        if takes_a_seed(loader):
            return loader(0 if seed is None else checked_seed(seed))
    except ValueError:  # a built-in function without a readable signature: calling it will show
        pass
    return loader()


def begin_with(
    policy: Act | str, environment: Environment | None = None, plans: "Plans | None" = None
) -> Begin:
    """A function that begins the episodes of a policy.

    Args:
      policy: a function as for `launch`, a name as in `limberjack.policies`, or 'none'.
      environment: the one to act in, if it is known.
      plans: keeps the planner's plans; None if they are not shown.

    Raises:
      PolicyError: there is no policy of that name, or it does not fit.
      TypeError: the policy is neither a function nor a name.
    """
    if isinstance(policy, str):
        if policy == NO_POLICY:
            return idle
        if policy == PLANNER and plans is not None and environment is not None:
            return plans.begin_with(environment)
        return begin_policy(policies.find(policy, environment))
    if not callable(policy):
        raise TypeError(
            f"policy is {policy!r}; expected a function from a TimeStep to an action, or a name "
            "such as 'random'"
        )
    reset = getattr(policy, "reset", None)

    def begin(environment: Environment, seed: int) -> Act:
        if reset is not None:
            reset()
        return policy

    return begin


def offered(
    environment: Environment, given: Sequence[Act | str], plans: "Plans | None" = None
) -> dict[str, Begin]:
    """The policies that a person can choose from, by name: those given, then the built-in ones.

    Args:
      environment: the one to act in; built-in policies that do not fit it are left out.
      given: names as in `limberjack.policies`, 'none', and functions as for `launch`, which are
        called 'policy', 'policy 2' and so on; the first acts first.
      plans: keeps the planner's plans; None if they are not shown.

    Raises:
      PolicyError: there is no policy of one of the names, or it does not fit.
      TypeError: one is neither a name nor a function.
    """
    found: dict[str, Begin] = {}
    functions = 0
    spec = getattr(environment, "action_spec", lambda: None)()
    is_plain = isinstance(spec, specs.BoundedArray)  # as the built-in ones need it
    for one in [*given, NO_POLICY, *(policies.BUILT_IN if is_plain else ())]:
        if not isinstance(one, str):
            functions += 1
            found["policy" if functions == 1 else f"policy {functions}"] = begin_with(one)
        elif one not in found:
            try:
                found[one] = begin_with(one, environment, plans)
            except (policies.PolicyError, ValueError):  # the latter of its actions
                if one in given:
                    raise
    return found


class Plans:
    """The plans of the policy 'planner' as it makes them, for a session to show."""

    def __init__(self) -> None:
        """Nothing has been planned."""
        self._last: Plan | None = None
        self._planner: Planner | None = None
        self._weights: dict[str, float] = {}  # that a person has set

    def last(self) -> Plan | None:
        """The last plan of this episode."""
        return self._last

    def begin_with(self, environment: Environment) -> Begin:
        """A function that begins the planner's episodes.

        Raises:
          PolicyError: there is no cost for the environment's task.
        """
        actor = policies.planner(environment, on_plan=self._on_plan, on_begin=self._on_begin)
        begin = begin_policy(actor)

        def begin_episode(environment: Environment, seed: int) -> Act:
            self._last = None
            return begin(environment, seed)

        return begin_episode

    def weigh(self, term: str, weight: float) -> None:
        """Gives a term of the planner's cost another weight, in later episodes too.

        Raises:
          ValueError: the weight is negative or not finite, or no planner has begun.
        """
        if self._planner is None:
            raise ValueError("no planner acts; choose the policy 'planner' first")
        if term == TERMINAL:
            raise ValueError("what is terminal has no weight: it is added to the terms' sum")
        self._planner.cost.weigh(term, weight)
        self._weights[term] = weight

    def _on_begin(self, planner: "Planner") -> None:
        self._planner = planner
        for term, weight in self._weights.items():
            planner.cost.weigh(term, weight)

    def _on_plan(self, time: float, stage: str, terms: Mapping[str, float]) -> None:
        assert self._planner is not None  # it has just planned
        self._last = Plan(stage, terms, self._planner.cost.weights)


def begin_policy(actor: policies.Actor) -> Begin:
    """A function that begins the episodes of a policy from `policies.find`."""

    def begin(environment: Environment, seed: int) -> Act:
        act = actor.begin_alone(environment, seed)
        return lambda time_step: act(time_step.observation)

    return begin
