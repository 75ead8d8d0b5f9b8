"""Row i of a batch is dm_control's own environment with seed + i, bit for bit.

Every task plays 36 time steps of each row, across the end of an episode and a reset in the middle
of one: the representative tasks in batches of 1, 5 and 16, the others in one of them. The modes of
autoreset and one or two threads rotate over sizes and tasks.

Of 16 rows and more, five are compared with dm_control; which ones rotates over the tasks as well,
because that many environments of dm_control would take longer than the batch. The laws compare
batches of 64 with each other, and `make test-exactness` compares all rows of 1, 5 and 64, in all
modes and numbers of threads, with dm_control, for 300 time steps: more rows take more time, but no
other path through the code until rows share an `MjData`, as 200 rows do here.
"""

import pytest
from gymnasium.vector import AutoresetMode

from tests.representatives import FEATURES

from . import twins
from .rows import Play, first_difference

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

_SEED = 21
_STEPS, _EPISODE = 36, 20
_STEPS_OF_THE_LARGEST, _EPISODE_OF_THE_LARGEST = 30, 18
_FEW, _MANY, _MOST = 5, 16, 200
_LARGE = [
    FEATURES[feature]
    for feature in (
        "a free root and contacts in three dimensions",
        "model fields set at each start, and kinds of starts",
        "starts that are rejected, and starts at the goal",
        "many bodies that touch, and a goal of several terms",
    )
]


def _some(num_envs: int, number: int) -> list[int]:
    """The last row and four others that depend on the number of the task."""
    spread = [(number * 5 + 13 * part) % (num_envs - 1) for part in range(4)]
    return sorted({*spread, num_envs - 1})


@pytest.mark.parametrize(
    ("number", "task"), list(enumerate(twins.TASKS)), ids=[":".join(task) for task in twins.TASKS]
)
def test_rows_are_dm_controls_environments(number: int, task: tuple[str, str]) -> None:
    play = Play(task, _SEED, _STEPS, _EPISODE)
    compared = {1: [0], _FEW: list(range(_FEW)), _MANY: _some(_MANY, number)}
    modes = list(AutoresetMode)
    if task not in FEATURES.values():
        compared = dict([list(compared.items())[number // len(modes) % len(compared)]])
    expected = play.of_dm_control(sorted({row for rows in compared.values() for row in rows}))
    for turn, (num_envs, rows) in enumerate(compared.items(), number):
        mode, num_threads = modes[turn % len(modes)], 1 + turn // len(modes) % 2
        found = play.of_batch(num_envs, num_threads, mode)
        where = f"{num_envs} rows, {num_threads} threads, {mode.value}"
        assert not first_difference(found, expected.some(rows)), where


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("share", ["shared"], indirect=True)  # as of more than 256 rows
@pytest.mark.parametrize("task", _LARGE, ids=":".join)
def test_some_of_200_rows_are_dm_controls_environments(task: tuple[str, str]) -> None:
    play = Play(task, _SEED, _STEPS_OF_THE_LARGEST, _EPISODE_OF_THE_LARGEST)
    expected = play.of_dm_control(_some(_MOST, twins.TASKS.index(task)))
    assert not first_difference(play.of_batch(_MOST, num_threads=2), expected)
