"""`batch_of`: a batch of any environment, vectorised if the task's code can serve all rows at once.

    from limberjack import rl

    batch = rl.batch_of(environment, num_envs=256, seed=0)
    batch = rl.batch_of(build, num_envs=256, seed=0)    # build(seed) makes an environment
    batch.why_rows      # None: vectorised; otherwise the reason, with the change to make

A vectorised batch computes the quantities of all rows in one call; see `rl.batch`. Where that would
give other numbers than single environments, the rows are complete environments; see `rl.rows`.
"""

from collections.abc import Mapping, Sequence

import dm_env

from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batch_errors import NotVectorised
from limberjack.rl.batch_safety import check_plain
from limberjack.rl.builds import Build, Make, is_stable
from limberjack.rl.control import Environment
from limberjack.rl.copies import difference
from limberjack.rl.episode_values import declared
from limberjack.rl.guards import at_least_one, first_seed
from limberjack.rl.memory import is_of_the_suite
from limberjack.rl.rows import RowsEnvironment
from limberjack.utils.log import log

__all__ = ["NOT_VECTORISED", "batch_of", "vectorisable"]

NOT_VECTORISED = "not vectorised: %s"  # logged with the reason, which commands print
_COMPARED = 8  # rows, about, whose environments are compared with those of their seeds


def batch_of(
    environment_or_build: dm_env.Environment | Make | Build,
    num_envs: int,
    num_threads: int | None = None,
    *,
    seed: int | None = None,
    vectorised: bool | None = None,
    on_divergence: str = "end",
    contexts: Sequence[Mapping[str, object]] | None = None,
    action_repeat: int | None = None,
    stagger: bool = False,
) -> Batch:
    """Many episodes in lockstep; row i equals the single environment with seed `seed + i`.

    Args:
      environment_or_build: a `dm_env.Environment`, which is copied, or a function `build(seed)`
        that makes one.
      num_envs: number of rows.
      num_threads: number of threads; by default as many cores as a step can occupy.
      seed: of the first row; None for an arbitrary seed.
      vectorised: None vectorises the task if that changes no number; True raises the reason if it
        would; False makes complete environments.
      on_divergence: 'end' ends the episodes of rows that diverge; 'raise' raises `PhysicsError`.
      contexts: keywords for `build`, for each row, which are then complete environments.
      action_repeat: control steps per action; None for the environment's own. See
        `control.Environment.step`.
      stagger: end the first episode of each row after a random number of steps, so that rows do not
        end together; see `limberjack.rl.streams`.

    Raises:
      ValueError: a number is out of range; or `vectorised` is True and the task cannot be
        vectorised.
      TypeError: it is neither an environment nor a function that makes one, or copies of the
        environment would share state.
      MemoryError: this many rows do not fit into memory.
    """
    num_envs = at_least_one("num_envs", num_envs)
    if vectorised not in (None, True, False):
        raise ValueError(f"vectorised is {vectorised!r}; expected None, True or False")
    first = first_seed(seed, num_envs)
    given = environment_or_build
    if not isinstance(given, dm_env.Environment | Build):
        given = Build.of(given).for_seeds(_spread(first, num_envs))
    try:
        if contexts is not None:
            raise NotVectorised("contexts were given, with which each row is made by itself")
        if vectorised is False:
            raise NotVectorised("rows were asked for")
        env = _single(given, first)
        return BatchEnvironment.from_environment(
            env, num_envs, num_threads, first, on_divergence, stagger, action_repeat
        )
    except NotVectorised as reason:
        if vectorised:
            raise
        why = str(reason.args[0])
        if vectorised is None and contexts is None:
            log.info(NOT_VECTORISED, why)
        build = Build.of(given)
        how = num_envs, num_threads, first, on_divergence, contexts, action_repeat, stagger
        return RowsEnvironment(build, *how, why_rows=why)


def vectorisable(env: object) -> Environment:
    """The environment itself, for code that supports no other kind.

    Raises:
      ValueError: it has methods or attributes of its own, or its task cannot be vectorised, as one
        that remembers something between steps.
    """
    check_plain(env)
    assert isinstance(env, Environment)
    if is_of_the_suite(env.task, env.physics):
        return env
    if declared(env.task):
        raise ValueError(
            f"task {type(env.task).__name__} remembers {', '.join(declared(env.task))} "
            "(EPISODE_ATTRIBUTES); policies of observations and batches play such tasks"
        )
    try:
        BatchEnvironment.from_environment(env, 1, 1, seed=0).close()
    except NotVectorised as reason:
        raise ValueError(
            f"{reason.args[0]}; policies of observations and batches play such tasks"
        ) from reason
    return env


def _spread(first: int, num_envs: int) -> list[int]:
    """A few of the seeds of rows, among them the last one's."""
    last = first + num_envs - 1
    return [*range(first + 1, last, max(1, num_envs // _COMPARED)), last]


def _single(given: dm_env.Environment | Make | Build, seed: int) -> Environment:
    """The environment whose task is to be vectorised.

    Raises:
      NotVectorised: it is not a plain one, or the function makes another one for each seed.
    """
    env: object = given
    if not isinstance(given, dm_env.Environment):
        build = Build.of(given)
        env = build.original
        if env is None:
            env = build.make(seed)
            if difference(env) is None and not is_stable(build, seed):
                raise NotVectorised(
                    f"{build.name} makes environments that differ in more than their seed: draw "
                    "what depends on the seed from task.random in initialize_episode, or in "
                    "begin_stream what belongs to a seed's model"
                )
    check_plain(env)
    assert isinstance(env, Environment)
    return env
