"""The command `limberjack`: list the tasks, run one and watch it, measure how fast one steps.

    limberjack list
    limberjack run humanoid walk --policy random --episodes 3 --out demo
    limberjack bench humanoid walk --num-envs 256

Tables go to standard output; the progress bar, notes and errors go to standard error. The exit
status is 0, 1 if a run failed, 2 for a mistake on the command line, 130 after Ctrl-C, 143 after
SIGTERM, which ends a command as tidily.

A command is a module here that adds itself to `app`. Everything heavy is imported by the command
that needs it, when it runs, so that `--help` answers at once.
"""

from limberjack.cli import (  # noqa: F401 (they add their commands)
    bench,
    doctor,
    evaluate,
    gallery,
    listing,
    record,
    replay,
    run,
    solve,
    view,
)
from limberjack.cli.app import app, main

__all__ = ["app", "main"]
