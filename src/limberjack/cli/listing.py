"""`limberjack list`: the tasks."""

import math

from limberjack.cli.app import app
from limberjack.cli.output import console, table

__all__: list[str] = []


@app.command("list")
def _list() -> None:
    """List the tasks, their tags, and the sizes of actions and observations."""
    from limberjack import suite

    tags = {
        "benchmarking": suite.BENCHMARKING,
        "easy": suite.EASY,
        "hard": suite.HARD,
        "extra": suite.EXTRA,
    }
    rows = table("domain", "task", "tags", "action>", "observation>")
    for domain, task in suite.ALL_TASKS:
        environment = suite.load(domain, task)
        observation = environment.observation_spec().values()
        rows.add_row(
            domain,
            task,
            ", ".join(tag for tag, tasks in tags.items() if (domain, task) in tasks),
            str(math.prod(environment.action_spec().shape)),
            str(sum(math.prod(spec.shape) for spec in observation)),
        )
        environment.close()
    console().print(rows)
