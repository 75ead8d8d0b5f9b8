"""What a run leaves behind: result.json, return.png, video.mp4 and report.html.

    from limberjack.report import Recorder, fingerprint

It needs no display; matplotlib and ffmpeg are imported when they are used.
"""

from limberjack.report.curve import write_distribution_plot, write_return_plot
from limberjack.report.page import write_page
from limberjack.report.recorder import Recorder
from limberjack.report.result import Facts, fingerprint, versions, write_result
from limberjack.report.trace import Trace

__all__ = [
    "Facts",
    "Recorder",
    "Trace",
    "fingerprint",
    "versions",
    "write_distribution_plot",
    "write_page",
    "write_result",
    "write_return_plot",
]
