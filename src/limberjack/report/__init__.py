"""What a run leaves behind: result.json and return.png.

    from limberjack.report import fingerprint, write_result, write_return_plot
"""

from limberjack.report.curve import write_return_plot
from limberjack.report.result import fingerprint, versions, write_result

__all__ = ["fingerprint", "versions", "write_result", "write_return_plot"]
