"""Training of policies with one algorithm and one table of settings; needs the extra `train`.

    from limberjack.training import train

    run = train("cartpole", "swingup", out="cartpole")
    print(run.curve[-1].mean, run.policy)

`limberjack train cartpole swingup --out cartpole` does the same. See docs/training.md.
"""

from limberjack.training.run import Evaluation, Run, TrainingError, train
from limberjack.training.settings import TABLE, Settings, read_settings, settings_for

__all__ = [
    "TABLE",
    "Evaluation",
    "Run",
    "Settings",
    "TrainingError",
    "read_settings",
    "settings_for",
    "train",
]
