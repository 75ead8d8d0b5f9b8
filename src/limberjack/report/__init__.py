"""What a run leaves behind: result.json, return.png and video.mp4.

    from limberjack.report import Recorder, fingerprint

It needs no display; matplotlib and ffmpeg are imported when they are used.
"""

from limberjack.report.curve import write_return_plot
from limberjack.report.recorder import Recorder
from limberjack.report.result import fingerprint, versions, write_result

__all__ = ["Recorder", "fingerprint", "versions", "write_result", "write_return_plot"]
