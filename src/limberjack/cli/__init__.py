"""The command `limberjack`: lists the tasks, runs and shows them, and measures their speed.

    limberjack list
    limberjack run humanoid walk --policy random --episodes 3 --out demo
    limberjack bench humanoid walk --num-envs 256

Tables go to standard output; progress bars, notes and errors go to standard error. The exit status
is 0, or 1 if a run failed, 2 for a mistake on the command line, 130 after Ctrl-C, and 143 after
SIGTERM, which is handled as Ctrl-C is.

A module here adds one command to `app`, or those on one thing: `datasets`, `policies`, `suite`. A
command imports large packages only as it runs, so that `--help` answers at once.
"""

from limberjack.cli import (  # noqa: F401 (they add their commands)
    bench,
    collect,
    datasets,
    doctor,
    evaluate,
    policies,
    record,
    run,
    solve,
    suite,
    train,
    view,
)
from limberjack.cli.app import app, main

__all__ = ["app", "main"]
