"""`limberjack list`: the tasks."""

import math

from limberjack.cli.app import app
from limberjack.cli.output import complain, console, table

__all__: list[str] = []


@app.command("list")
def _list() -> None:
    """List the tasks, their tags, and the sizes of actions and observations.

    The domains of installed packages, and those of modules given as `limberjack --import MODULE
    list`, are among them.
    """
    from limberjack import suite

    for name, problem in suite.find_installed().items():
        complain(f"domain {name!r} is left out: {problem}")
    rows = table("domain", "task", "tags", "action>", "observation>")
    for domain, task in suite.tasks():
        factories = suite.module_of(domain).SUITE
        tags = [tag for tag in factories.tags() if task in factories.tagged(tag)]
        if (domain, task) not in suite.BENCHMARKING:
            tags.append("extra")
        environment = suite.load(domain, task)
        observation = environment.observation_spec().values()
        rows.add_row(
            domain,
            task,
            ", ".join(tags),
            str(math.prod(environment.action_spec().shape)),
            str(sum(math.prod(spec.shape) for spec in observation)),
        )
        environment.close()
    console().print(rows)
