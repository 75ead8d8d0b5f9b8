"""Policies by name: built-in and bundled ones, a callable of your own, or a file.

    actor = policies.find("random")
    act = actor.begin_alone(environment, seed)       # after the reset of an episode
    action = act(time_step.observation)

| name | policy |
|---|---|
| `zero`, `random` | the action nearest to zero; uniform actions within the bounds |
| `planner` | `limberjack.planner`, which plans from the environment's full state |
| `pretrained` | the task's learned policy that the package brings; `bundled()` lists them |
| `mlp:PATH` | a network in a file, with its card: see `limberjack.policies.mlp` |
| `onnx:PATH` | a model of ONNX with such a card: see `limberjack.policies.onnx` |
| `sb3:PATH` | a model that Stable-Baselines3 has saved, acting without exploration |
| `MODULE:CALLABLE` | a function, an object or a class of your own |

MODULE:CALLABLE names one of

- a function from an observation (an `OrderedDict` of arrays) to an action;
- an object with `act(observation)` and, optionally, `reset()`, called at the start of each episode;
- an object with `act_batch(observations)`, which acts on 64 rows at once; see `policies.actors`;
- a class whose objects are one of these. It is called once, without arguments.

A policy receives the observation only. The planner is the exception: it reads the environment.

`find` resolves the name for every command and function that takes one, and returns an `Actor`,
which plays the rows of a batch or, alone, one environment. Nothing here trains.
"""

from limberjack.policies.built_in import BUILT_IN, planner, random, zero
from limberjack.policies.kinds import ROWS, Act, Actor, Policy, PolicyError
from limberjack.policies.learning import Learning, LearningCurve, known_tasks, learning_of
from limberjack.policies.named import name_of
from limberjack.policies.networks import PRETRAINED, Bundled, bundled
from limberjack.policies.resolver import find, policy_for
from limberjack.policies.saved import is_saved_model, runs_code

__all__ = [
    "BUILT_IN",
    "PRETRAINED",
    "ROWS",
    "Act",
    "Actor",
    "Bundled",
    "Learning",
    "LearningCurve",
    "Policy",
    "PolicyError",
    "bundled",
    "find",
    "is_saved_model",
    "known_tasks",
    "learning_of",
    "name_of",
    "planner",
    "policy_for",
    "random",
    "runs_code",
    "zero",
]
