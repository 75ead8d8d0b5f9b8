"""Files of a run or an evaluation: result.json, return.png, video.mp4, report.html.

    from limberjack.see.report import Recorder, Step

No display is needed; matplotlib and ffmpeg are imported when they are used.
"""

from limberjack.see.report.curve import (
    write_distribution_plot,
    write_learning_plot,
    write_return_plot,
)
from limberjack.see.report.evaluation_page import EvaluationResult, write_evaluation_page
from limberjack.see.report.labels import Label, Labels, labels_of
from limberjack.see.report.page import write_page
from limberjack.see.report.recorder import Recorder
from limberjack.see.report.result import Played, write_result
from limberjack.see.report.trace import Step, Trace

__all__ = [
    "EvaluationResult",
    "Label",
    "Labels",
    "Played",
    "Recorder",
    "Step",
    "Trace",
    "labels_of",
    "write_distribution_plot",
    "write_evaluation_page",
    "write_learning_plot",
    "write_page",
    "write_result",
    "write_return_plot",
]
