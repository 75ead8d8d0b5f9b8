"""Published task files: their tasks in batches, as they stand and changed as the errors say.

`test_clients.py` compares them with dm_control as single environments.
"""

import functools
import json
import re
from pathlib import Path

import pytest

from tests.programs import INSTALL
from tests.warm import run

pytest.importorskip("lxml", reason="published task files edit their models with lxml")

_HERE = Path(__file__).parent
_ROWS = (3, 4)  # with three rows, a vector in space has the shape of one number per row

# The many models compile in a fifth of the time.
_SMALL_SKY = "from tests.small_sky import small_sky; sky = small_sky(); sky.__enter__()"

# Plays each task as a batch and as single environments with the rows' seeds.
_PLAY = """
import json, sys
import numpy as np
from limberjack.rl.batch import BatchEnvironment

num_envs = int(sys.argv[1])
for domain, task in [*custom_tasks.CUSTOM, *((None, task) for task in custom_tasks.SUITE)]:
    env = custom_tasks.load(domain, task, 0)
    try:
        batch = BatchEnvironment.from_environment(env, num_envs, 1, seed=5)
    except ValueError as error:
        print(json.dumps([task, str(error)]))
        continue
    singles = [custom_tasks.load(domain, task, 5 + row) for row in range(num_envs)]
    spec, stream = env.action_spec(), np.random.RandomState(0)
    together, alone = batch.reset(), [single.reset() for single in singles]
    for _ in range(20):
        for row, step in enumerate(alone):
            if not step.first():
                np.testing.assert_array_equal(together.reward[row], step.reward, task)
            for name, value in step.observation.items():
                np.testing.assert_array_equal(together.observation[name][row], value, task)
        actions = stream.uniform(spec.minimum, spec.maximum, (num_envs, *spec.shape))
        together = batch.step(actions)
        alone = [single.step(action) for single, action in zip(singles, actions)]
    print(json.dumps([task, "is right"]))
"""

# What the errors below ask for.
_CHANGES = """
from limberjack.utils import arrays

def momentum(self):
    return self.named.data.subtree_angmom["torso", 1]

def finger_to_target_dist(self):
    return arrays.norm(self.finger_to_target())

def whirling(self, physics):
    speed = arrays.norm(physics.angular_velocity())
    return custom_tasks.rewards.tolerance(speed, (3, np.inf), margin=5)

def in_target(self):
    room = self.named.model.site_size["target", [0, 2]] - self.named.model.geom_size["ball", 0]
    return (abs(self.ball_to_target()) < room).all(axis=-1)

def slinging(self, physics):
    velocities = physics.named.data.qvel[["ball_x", "ball_z"]]
    fast = custom_tasks.rewards.tolerance(arrays.norm(velocities), (2, 9), margin=1)
    return (1 - physics.in_target()) * fast

def near_wall(self, physics, name, distance):
    places = physics.named.data.geom_xpos
    nearest = arrays.minimum_of(
        abs(places[name] - places[wall])[..., :2].min(axis=-1) for wall in ("wall0", "wall1")
    )
    return nearest < distance

def swimming(self, physics):
    close = custom_tasks.rewards.tolerance(arrays.norm(physics.mouth_to_target()), margin=0.2)
    return np.where(self._near_wall(physics, "torso", distance=0.01), 0.0, close)

custom_tasks.CheetahPhysics.momentum = momentum
custom_tasks.LinksPhysics.finger_to_target_dist = finger_to_target_dist
custom_tasks.Whirl.get_reward = whirling
custom_tasks.CupPhysics.in_target = in_target
custom_tasks.Sling.get_reward = slinging
custom_tasks.Walled.EPISODE_FIELDS = ("geom_pos",)
custom_tasks.Walled._near_wall = near_wall
custom_tasks.Walled.get_reward = swimming
"""

_NORM = r"arrays\.norm\(x\) of limberjack\.utils for np\.linalg\.norm\(x\)"
_EXPECTED = {
    "tiptoe": "^is right$",
    "back_up": "^is right$",
    "hop_back": "^is right$",
    "rear": "^is right$",
    "tumble": r"(momentum\(\)|the reward) of task GoalCheetah .*x\[\.\.\., 0\] for x\[0\]",
    "whirl": f"^the reward of task Whirl is .* in row . of a batch .*{_NORM}",
    "three_links": rf"^physics\.finger_to_target_dist\(\) of task LinksReacher .*{_NORM}",
    "sling": r"^the reward of task Sling raises .*in_target, line .*x\.all\(axis=-1\) for all\(x\)",
    "walled": r"^the reward of task Walled .*index with `\.\.\.`",
    "corner": r"^task Corner draws from NumPy's global random stream in initialize_episode",
    "many_goals": r"^task ManyGoals sets physics\._hinge_names, physics\._sensor_names in get_obs",
}
_REFUSED = ("corner", "many_goals")  # after the changes too


@functools.cache
def _played(num_envs: int, changes: str = "") -> dict[str, str]:
    program = f"{INSTALL}\n{_SMALL_SKY}\nimport custom_tasks\n{changes}\n{_PLAY}"
    printed = run(program, str(num_envs), path=_HERE)
    return dict(json.loads(line) for line in printed.splitlines())


@pytest.mark.parametrize("num_envs", _ROWS)
@pytest.mark.parametrize("task", _EXPECTED)
def test_in_a_batch_a_task_is_right_or_refused_with_what_to_change(
    task: str, num_envs: int
) -> None:
    assert set(_played(num_envs)) == set(_EXPECTED)
    result = _played(num_envs)[task]
    assert re.search(_EXPECTED[task], result), result


@pytest.mark.parametrize("task", [task for task in _EXPECTED if task not in _REFUSED])
def test_changed_as_the_error_says_a_task_is_right(task: str) -> None:
    assert _played(4, _CHANGES)[task] == "is right"
